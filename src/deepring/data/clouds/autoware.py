"""Autoware's point cloud maps: a folder of .pcd tiles and a file that says where each one lies.

``pointcloud_map_metadata.yaml`` holds ``x_resolution`` and ``y_resolution``, the size of a tile in
metres, and for each tile ``NAME.pcd: [x, y]``, its lowest corner. It lies in the folder of the
tiles or beside that folder, which is then called ``pointcloud_map.pcd`` or ``pointcloud_map``.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.data.clouds.cloud_file import open_cloud_file
from deepring.data.clouds.precision import PrecisionCheck
from deepring.data.clouds.tiles import Points, Tile, TiledCloud
from deepring.data.clouds.voxels import thinned
from deepring.data.scans.names import files_with
from deepring.data.scans.returns import is_return
from deepring.errors import DataError, FileError
from deepring.io.plain_yaml import plain_yaml
from deepring.io.text import read_text
from deepring.text import shown

METADATA = "pointcloud_map_metadata.yaml"
#: Folders of tiles beside their metadata.
TILES = ("pointcloud_map.pcd", "pointcloud_map")
_SIZES = ("x_resolution", "y_resolution")

#: Metres by which points may be outside of their tile, by rounding.
_OUTSIDE = 0.05
#: Share of points of a tile that may be outside of it.
_STRAYS = 0.01

Warn = Callable[[str], None]


class Metadata(NamedTuple):
    """Where tiles lie."""

    file: Path
    size: NDArray[np.float64]
    """(2,) of each tile, metres."""
    corners: dict[str, NDArray[np.float64]]
    """(2,) lowest x and y of each tile, metres, by the name of its file."""


def metadata_of(folder: Path) -> Path | None:
    """The metadata in a folder or, for a folder of tiles, beside it; None where there is none."""
    places = [folder] if folder.resolve().name not in TILES else [folder, folder.resolve().parent]
    return next((place / METADATA for place in places if (place / METADATA).is_file()), None)


def tiles_folder(folder: Path) -> Path:
    """The folder of the tiles of a map's folder: itself, or one of `TILES` in it."""
    if files_with(folder, {".pcd"}):
        return folder
    return next((folder / name for name in TILES if (folder / name).is_dir()), folder)


def open_autoware(folder: Path, file: Path, warn: Warn) -> TiledCloud:
    """The cloud of a folder whose metadata is ``file``; its tiles are read as needed.

    ``warn`` is told of .pcd files that the metadata does not name, which are left out. Raises
    FileError for damaged metadata, and for a tile that it names and that is not there.
    """
    metadata = read_metadata(file)
    tiles = tiles_folder(folder)
    missing = [name for name in metadata.corners if not (tiles / name).is_file()]
    if missing:
        raise FileError(
            f"{file}: {len(missing)} of its {len(metadata.corners)} tiles are not in {tiles}, "
            f"first {missing[0]}; expected all of them: copy them there, or take their lines out"
        )
    others = [one.name for one in files_with(tiles, {".pcd"}) if one.name not in metadata.corners]
    if others:
        warn(
            f"{tiles}: left out {len(others)} files that {METADATA} does not name, first "
            f"{others[0]}"
        )
    files = {name: open_cloud_file(tiles / name) for name in metadata.corners}
    count = sum(one.points for one in files.values())
    if not count:
        raise DataError(f"cloud {folder}: no points in {len(files)} tiles; expected an area's")
    heights = _Heights(tiles)
    return TiledCloud(
        str(folder),
        [
            Tile(
                name=name,
                corner=np.array([*metadata.corners[name], heights.origin(metadata)]),
                size=metadata.size,
                read=_reader(tiles / name, metadata, name, heights),
            )
            for name in metadata.corners
            if files[name].points
        ],
        count,
    )


def read_metadata(file: Path) -> Metadata:
    """Read a `METADATA` file. Raises FileError for what is none."""
    text = read_text(file, f"{', '.join(_SIZES)}, and a line NAME.pcd: [x, y] for each tile")
    try:
        values = plain_yaml(text)
    except DataError as error:
        raise FileError(f"{file}: {error}") from None
    if not isinstance(values, dict):
        raise FileError(f"{file}: {shown(values, 80)}, expected x_resolution, y_resolution, tiles")
    for name in _SIZES:
        if name not in values:
            raise FileError(f"{file}: no {name}, expected the size of a tile along it in metres")
    sizes = [_number(file, name, values[name]) for name in _SIZES]
    if min(sizes) <= 0:
        raise FileError(f"{file}: tiles of {sizes[0]:g} x {sizes[1]:g} m, expected more than 0")
    corners = {
        str(name): _corner(file, str(name), value)
        for name, value in values.items()
        if name not in _SIZES
    }
    if not corners:
        raise FileError(f"{file}: names no tile, expected a line NAME.pcd: [x, y] for each")
    _expect_apart(file, np.array(sizes), corners)
    return Metadata(file, np.array(sizes), corners)


def _number(file: Path, name: str, value: Any) -> float:
    if not checks.is_number(value):
        raise FileError(f"{file}: {name[:80]}: {shown(value, 80)}, expected a number of metres")
    return float(value)


def _corner(file: Path, name: str, value: Any) -> NDArray[np.float64]:
    if Path(name).name != name or not name.lower().endswith(".pcd"):
        raise FileError(f"{file}: {name[:80]}, expected names of .pcd files in the tiles' folder")
    if not isinstance(value, list) or len(value) != 2:
        raise FileError(f"{file}: {name[:80]}: {shown(value, 80)}, expected [x, y] in metres")
    return np.array([_number(file, name, each) for each in value])


def _expect_apart(file: Path, size: NDArray, corners: dict[str, NDArray[np.float64]]) -> None:
    """Raise FileError for tiles of one place."""
    seen: dict[tuple[int, int], str] = {}
    for name, corner in corners.items():
        i, j = np.rint(corner / size * 1e3).astype(np.int64).tolist()
        if (i, j) in seen:
            raise FileError(
                f"{file}: {seen[i, j][:80]} and {name[:80]} lie both at {corner[0]:g}, "
                f"{corner[1]:g}; expected tiles beside each other"
            )
        seen[i, j] = name


class _Heights:
    """z from which the points of all tiles are counted: that of the first point."""

    def __init__(self, tiles: Path) -> None:
        self.tiles = tiles
        self._origin: float | None = None

    def origin(self, metadata: Metadata) -> float:
        if self._origin is None:
            self._origin = 0.0
            for name in metadata.corners:
                for chunk in open_cloud_file(self.tiles / name).chunks():
                    z = chunk.points[is_return(chunk.points), 2]
                    if len(z):
                        self._origin = float(np.floor(np.median(z)))
                        return self._origin
        return self._origin


def _reader(path: Path, metadata: Metadata, name: str, heights: _Heights) -> Callable[[], Points]:
    corner = np.array([*metadata.corners[name], heights.origin(metadata)])

    def read() -> Points:
        parts, precision = [np.empty((0, 3), dtype=np.float32)], PrecisionCheck(str(path))
        for chunk in open_cloud_file(path).chunks():
            points = chunk.points[is_return(chunk.points)]
            if chunk.single:
                precision.add(points)
            parts.append(thinned((points - corner).astype(np.float32)))
        precision.expect_enough()
        whole = thinned(np.concatenate(parts))
        _expect_inside(whole, path, metadata, name)
        return whole

    return read


def _expect_inside(points: Points, path: Path, metadata: Metadata, name: str) -> None:
    """Raise DataError unless a tile's points are where the metadata says."""
    near = (points[:, :2] > -_OUTSIDE) & (points[:, :2] < metadata.size + _OUTSIDE)
    outside = int((~near.all(axis=1)).sum())
    if outside > _STRAYS * len(points):
        x, y = metadata.corners[name]
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        raise DataError(
            f"cloud {path}: {outside} of {len(points)} points lie outside of their tile, x "
            f"{x:g} to {x + metadata.size[0]:g}, y {y:g} to {y + metadata.size[1]:g} as "
            f"{METADATA} says: x {x + low[0]:.1f} to {x + high[0]:.1f}, y {y + low[1]:.1f} to "
            f"{y + high[1]:.1f}; "
            "correct the metadata"
        )
