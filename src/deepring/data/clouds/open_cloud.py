"""Opens the point cloud of an area: a file, Autoware's folder of tiles, a folder of LAS files."""

import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deepring.data.clouds.autoware import METADATA, TILES, Warn, metadata_of, open_autoware
from deepring.data.clouds.cloud_file import OPENERS, open_cloud_file
from deepring.data.clouds.sorted_tiles import sorted_tiles
from deepring.data.clouds.tiles import TiledCloud
from deepring.data.scans.names import ending_of, files_with
from deepring.errors import FileError
from deepring.progress import Progress

log = logging.getLogger(__name__)

#: Files with coordinates of the Earth, which fit each other without metadata.
_LAS = (".las", ".laz")


def is_cloud(path: Path) -> bool:
    """Whether a path is a cloud and no drive: by its ending, or by the files in a folder.

    A folder of .pcd or LAS files is one, with the metadata of tiles or without.
    """
    if not path.is_dir():
        return ending_of(path) in OPENERS
    if metadata_of(path) is not None or any((path / name).exists() for name in TILES):
        return True
    return bool(files_with(path, {".pcd", *_LAS}))


@contextmanager
def open_cloud(
    path: Path | str, warn: Warn = log.warning, progress: Progress | None = None
) -> Iterator[TiledCloud]:
    """The cloud of a path of which `is_cloud` is true, as tiles.

    Files are sorted into tiles in a temporary folder, as large as their thinned points; Autoware's
    tiles are read where they are.

    Args:
        path: .pcd, .ply, .las or .laz, a folder of LAS files, or one of Autoware's tiles.
        warn: told of what is left out; logged by default.
        progress: called with the numbers of points sorted and of all.

    Raises FileError for what is missing, and DataError for what is no cloud, see `CloudFile` and
    `sorted_tiles`.
    """
    path = Path(path)
    metadata = metadata_of(path) if path.is_dir() else None
    if metadata is not None:
        yield open_autoware(path, metadata, warn)
        return
    named = _files(path)
    if path.is_dir():
        others = [one for one in files_with(path, set(OPENERS)) if one not in named]
        if others:
            warn(
                f"{path}: left out {len(others)} files beside the {named[0].suffix} files, first "
                f"{others[0].name}"
            )
    files = [open_cloud_file(file) for file in named]
    with tempfile.TemporaryDirectory(prefix="deepring_tiles_") as folder:
        yield sorted_tiles(str(path), files, Path(folder), progress)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    las = files_with(path, _LAS)
    if las:
        return las
    inner = next((path / name for name in TILES if (path / name).exists()), path)
    if inner.is_file():
        return [inner]
    tiles = files_with(inner, {".pcd"})
    if len(tiles) == 1:
        return tiles
    raise FileError(
        f"cloud {path}: {len(tiles)} .pcd files and no {METADATA}, in it or beside it; expected it "
        "to hold x_resolution, y_resolution and a line NAME.pcd: [x, y] for each tile; scans of a "
        "drive are given with their `poses`"
    )
