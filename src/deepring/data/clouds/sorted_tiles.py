"""Files of a cloud sorted into square tiles on disk, without holding the cloud in memory."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.clouds.cloud_file import CloudFile
from deepring.data.clouds.plausibility import expect_unit
from deepring.data.clouds.precision import PrecisionCheck
from deepring.data.clouds.tiles import Points, Tile, TiledCloud
from deepring.data.clouds.voxels import thinned
from deepring.data.scans.returns import is_return
from deepring.errors import DataError
from deepring.progress import Progress

#: Side of a tile, metres, a whole number of voxels.
SIDE = 40.0

#: Farthest that a coordinate may be from the others, metres; what is beyond is no place on Earth.
_FARTHEST = 1e8


def sorted_tiles(
    source: str, files: Sequence[CloudFile], folder: Path, progress: Progress | None = None
) -> TiledCloud:
    """The cloud of some files as tiles in ``folder``, which has to stay as long as the cloud.

    Points are thinned (`deepring.data.clouds.voxels`); NaN and infinite ones and (0, 0, 0) are
    dropped. ``progress`` is called with the numbers of points read and of all.

    Raises DataError for a damaged file, a cloud without points, and coordinates whose precision is
    too low, see `PrecisionCheck`, or whose unit is not the metre.
    """
    total, done = sum(file.points for file in files), 0
    precision = PrecisionCheck(source)
    writer: _Writer | None = None
    for file in files:
        for chunk in file.chunks():
            points = chunk.points[is_return(chunk.points)]
            points = points[(np.abs(points) < _FARTHEST).all(axis=1)]
            if chunk.single:
                precision.add(points)
            if len(points):
                if writer is None:
                    expect_unit(source, points)
                    writer = _Writer(folder, np.floor(np.median(points, axis=0)))
                writer.add(points)
            done += len(chunk.points)
            if progress is not None:
                progress(done, max(done, total))
    precision.expect_enough()
    if writer is None:
        what = f"{done} points, all of them NaN, infinite or (0, 0, 0)" if done else "no points"
        raise DataError(f"cloud {source}: {what}; expected the points of an area, in metres")
    return TiledCloud(source, writer.tiles(), done)


class _Writer:
    """Appends points to the files of their tiles."""

    def __init__(self, folder: Path, origin: NDArray[np.float64]) -> None:
        self.folder, self.origin = folder, origin
        self.keys: set[tuple[int, int]] = set()

    def add(self, points: NDArray[np.float64]) -> None:
        relative = points - self.origin
        cells = np.floor(relative[:, :2] / SIDE).astype(np.int64)
        order = np.lexsort((cells[:, 1], cells[:, 0]))
        cells, relative = cells[order], relative[order]
        starts = np.flatnonzero(np.any(np.diff(cells, axis=0, prepend=cells[:1] - 1), axis=1))
        for start, end in zip(starts, [*starts[1:], len(cells)], strict=True):
            i, j = key = (int(cells[start, 0]), int(cells[start, 1]))
            local = (relative[start:end] - [i * SIDE, j * SIDE, 0.0]).astype(np.float32)
            self.keys.add(key)
            with self._file(key).open("ab") as file:
                thinned(local).tofile(file)

    def tiles(self) -> list[Tile]:
        return [
            Tile(
                name=f"{i} {j}",
                corner=self.origin + np.array([i * SIDE, j * SIDE, 0.0]),
                size=np.array([SIDE, SIDE]),
                read=self._reader((i, j)),
            )
            for i, j in sorted(self.keys)
        ]

    def _file(self, key: tuple[int, int]) -> Path:
        return self.folder / f"{key[0]}_{key[1]}.points"

    def _reader(self, key: tuple[int, int]) -> "_TileReader":
        return _TileReader(self._file(key))


class _TileReader:
    """Reads the file of a tile; parts of it came from several chunks, and are thinned together."""

    def __init__(self, path: Path) -> None:
        self.path, self.whole = path, False

    def __call__(self) -> Points:
        points = np.fromfile(self.path, dtype=np.float32).reshape(-1, 3)
        if not self.whole:
            points = thinned(points)
            points.tofile(self.path)
            self.whole = True
        return points
