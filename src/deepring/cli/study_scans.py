"""The scans of a study: of a dataset, or single files, with what is left out of them."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.readers import (
    binary_formats,
    detect_format,
    ground_of,
    list_sessions,
    open_session,
)
from deepring.data.readers.custom.drive_file import is_drive_file
from deepring.data.scans.returns import scan_from
from deepring.data.session import Points
from deepring.errors import BrokenScanError, ConfigError, DataError, FileError
from deepring.paper.moved_scans import Place, Scan
from deepring.rasters import BevRaster


class Source(NamedTuple):
    """Scan files, with the positions of their scans."""

    title: str
    format: str
    read: Callable[[int, Sequence[str]], Points]
    """A scan by its number, with these columns of its points behind x, y and z."""
    ground_z: float
    files: Sequence[Path]
    positions: NDArray[np.float64] | None  # (n, 2) metres; None for scans without poses
    columns: Sequence[str] = ()
    """What the points have beside their coordinates."""


def source_of(paths: Sequence[Path], format: str | None, session: str | None) -> Source:
    """A dataset's session, or scan files. Raises DeepringError for what is neither."""
    if len(paths) == 1 and (is_drive_file(paths[0]) or not paths[0].is_file()):
        return _dataset(paths[0], format, session)
    missing = [str(path) for path in paths if not path.is_file()]
    if missing:
        raise FileError(f"{missing[0]}: not a file, expected one dataset, or only scan files")
    formats = binary_formats()
    if format is None or format not in formats:
        raise ConfigError(
            f"{paths[0]}: a scan file without its format, expected it; give --format, one of "
            + ", ".join(formats)
        )
    if session is not None:
        raise ConfigError(
            f"--session {session}: expected only with the folder of a dataset; leave it out"
        )
    if len({path.resolve() for path in paths}) < len(paths):
        raise ConfigError("FILE: the same file twice, expected scans of different places")
    title = ", ".join(path.name for path in paths)
    scans = formats[format]

    def read(number: int, _columns: Sequence[str]) -> Points:
        return scan_from(scans.read(paths[number]), paths[number]).points

    return Source(title, format, read, scans.ground_z, paths, None)


def _dataset(root: Path, format: str | None, name: str | None) -> Source:
    format = format or detect_format(root)
    names = list_sessions(format, root)
    if name is not None and name not in names:
        raise ConfigError(f"--session {name}: not in {root}, expected one of {', '.join(names)}")
    session = open_session(format, root, name or names[0])
    folder = root.resolve().name
    title = folder if folder == session.name else f"{folder}, {session.name}"
    ground_z = ground_of(session, format)
    columns = tuple(session.columns)
    return Source(
        title, format, session.points, ground_z, session.files, session.positions, columns
    )


def readable(
    source: Source, seed: int, complaints: list[str], columns: Sequence[str] = ()
) -> Iterator[Scan]:
    """The scans of a dataset in random order; messages about broken ones go to ``complaints``.

    Scan files keep their order, and a broken one is an error. With ``columns``, their points have
    these behind x, y and z.
    """
    order = list(range(len(source.files)))
    if source.positions is not None:
        order = np.random.default_rng(seed).permutation(order).tolist()
    for k in order:
        try:
            points = _points(source, k, columns)
        except BrokenScanError as error:
            if source.positions is None:
                raise
            complaints.append(str(error))
            continue
        position = None if source.positions is None else source.positions[k]
        yield Scan(points, Place(k, position))


def expect_scans(source: Source, scans: Sequence[Scan], complaints: Sequence[str]) -> None:
    """Raise DataError where none could be read."""
    if not scans:
        raise DataError(
            f"{source.title}: none of its {len(source.files)} scans can be used "
            f"(first: {complaints[0]})"
        )


def _points(source: Source, number: int, columns: Sequence[str]) -> Points:
    """The points of a scan. Raises BrokenScanError if none of them is in the bird's-eye view."""
    points = source.read(number, columns)
    bev = BevRaster()
    if not bev(points[:, :3], source.ground_z).any():
        raise BrokenScanError(
            f"{source.files[number]}: {len(points)} points as {source.format}, expected some above "
            f"the ground within {bev.extent:g} m; check the file and --format"
        )
    return points
