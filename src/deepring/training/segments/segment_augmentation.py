"""Segments as they are seen from elsewhere: turned, thinned, cut (SegMap's augmentation)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.rasters.segment_shape import Cells, voxels


@dataclass(frozen=True)
class SegmentAugmentation:
    """What happens to each segment, drawn anew each time.

    It loses up to the share ``dropped`` of its voxels at random, then up to the share ``cut``
    beyond a plane of any direction, and is turned about z by any angle where ``turned`` is true.
    The segment then has a grid of its own again, as `voxels` makes it, but no alignment: so that
    features bear a heading that is told wrong. Since rasters hold no points, the middles of voxels
    stand for them.
    """

    turned: bool = True
    dropped: float = 0.1
    cut: float = 0.5
    smallest_voxel: float = 0.1

    def __post_init__(self) -> None:
        checks.share("sampling.dropped", self.dropped)
        checks.share("sampling.cut", self.cut)

    def __call__(
        self,
        occupied: NDArray[np.bool_],
        extents: NDArray[np.float32],
        rng: np.random.Generator,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """Voxels (x, y, z) and extents (3,), metres, of a segment changed; never without voxels."""
        cells: Cells = occupied.shape
        points = voxel_points(occupied, extents, self.smallest_voxel)
        points = points[rng.random(len(points)) >= rng.uniform(0, self.dropped)]
        direction = rng.normal(size=3)
        lost = int(rng.uniform(0, self.cut) * len(points))
        points = points[np.argsort(points @ direction, kind="stable")[lost:]]
        angle = rng.uniform(-np.pi, np.pi) * self.turned
        if not len(points):
            return occupied, extents
        c, s = np.cos(angle), np.sin(angle)
        turned = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        grid, lengths = voxels(turned, cells, self.smallest_voxel)
        return grid, lengths.astype(np.float32)


def voxel_points(
    occupied: NDArray[np.bool_], extents: NDArray[np.float32], smallest: float = 0.1
) -> NDArray[np.float64]:
    """The middles (n, 3), metres, of the voxels that a segment of these extents occupies.

    >>> grid = np.zeros((4, 4, 4), dtype=bool)
    >>> grid[0, 1, 3] = True
    >>> voxel_points(grid, np.array([6.0, 3.0, 0.0])).round(3).tolist()
    [[1.0, 1.5, 0.467]]
    """
    cells = np.array(occupied.shape)
    size = np.maximum(extents.astype(np.float64), smallest * cells) / (cells - 1)
    middles: NDArray[np.float64] = (np.argwhere(occupied) + 0.5) * size
    return middles
