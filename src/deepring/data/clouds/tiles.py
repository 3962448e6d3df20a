"""A cloud as tiles seen from above, of which a few are in memory at a time."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deepring.data.clouds.passing import without_passing

Points = NDArray[np.float32]
Corner = NDArray[np.float64]

#: Bytes of tiles that are kept in memory.
KEPT = 1 << 29


@dataclass(frozen=True)
class Tile:
    """A rectangle of a cloud, its sides along x and y."""

    name: str
    corner: NDArray[np.float64]
    """(3,) the lowest x and y, metres in the cloud's coordinates, and a z near its points'."""
    size: NDArray[np.float64]
    """(2,) along x and y, metres."""
    read: Callable[[], Points]
    """Its points (n, 3) float32, metres from the corner."""


class TiledCloud:
    """Tiles, read as they are needed.

    Args:
        source: names the cloud in messages.
        tiles: in any order; they do not overlap.
        points: points of the whole cloud, before it was thinned.
        passing: keep what passed while the cloud was recorded, see `without_passing`.
    """

    def __init__(
        self, source: str, tiles: Sequence[Tile], points: int, *, passing: bool = False
    ) -> None:
        self.source, self.tiles, self.points, self.passing = source, list(tiles), points, passing
        self._low = np.array([tile.corner[:2] for tile in tiles]).reshape(-1, 2)
        self._high = self._low + np.array([tile.size for tile in tiles]).reshape(-1, 2)
        self._kept: OrderedDict[int, Points] = OrderedDict()

    @property
    def low(self) -> NDArray[np.float64]:
        """(2,) lowest x and y of the tiles, metres."""
        return np.asarray(self._low.min(axis=0))

    @property
    def high(self) -> NDArray[np.float64]:
        """(2,) highest x and y of the tiles, metres."""
        return np.asarray(self._high.max(axis=0))

    def points_of(self, k: int) -> Points:
        """The points (n, 3) float32 of tile ``k``, metres from its corner."""
        if k in self._kept:
            self._kept.move_to_end(k)
            return self._kept[k]
        points = self.tiles[k].read()
        self._kept[k] = points = points if self.passing else without_passing(points)
        while len(self._kept) > 1 and sum(one.nbytes for one in self._kept.values()) > KEPT:
            self._kept.popitem(last=False)
        return points

    def parts(self, low: ArrayLike, high: ArrayLike) -> Iterator[tuple[Corner, Points]]:
        """Corner (3,) and points of each tile that shares ground with a rectangle (2,), (2,)."""
        overlap = (self._low < np.asarray(high)) & (self._high > np.asarray(low))
        for k in np.flatnonzero(overlap.all(axis=1)):
            yield self.tiles[k].corner, self.points_of(int(k))

    def within(self, low: ArrayLike, high: ArrayLike, origin: ArrayLike) -> Points:
        """The points (n, 3) float32 with x and y in [low, high), metres from ``origin`` (3,)."""
        origin = np.asarray(origin, dtype=np.float64)
        found = [np.empty((0, 3), dtype=np.float32)]
        for corner, points in self.parts(low, high):
            start = np.asarray(low, dtype=np.float64) - corner[:2]
            end = np.asarray(high, dtype=np.float64) - corner[:2]
            inside = ((points[:, :2] >= start) & (points[:, :2] < end)).all(axis=1)
            found.append(points[inside] + (corner - origin).astype(np.float32))
        return np.concatenate(found)
