"""A scan as points with classes, which can be moved: what Semantic Scan Context compares."""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.rasters.base import Raster
from deepring.rasters.classes import LANDMARKS, PRIORITY, classes_of
from deepring.rasters.preprocessing import Preprocessing, contiguous_points, coordinates
from deepring.rasters.semantic import Labelled, all_points

#: The points that a scan is thinned to lie in cells of this fraction of a polar cell, either way.
_FINER = 2

#: Largest coordinate as it is stored, which stands for the radius.
FULL = np.iinfo(np.int16).max

SectorPoint = Literal["nearest", "last"]


@dataclass(frozen=True)
class SemanticPointsRaster(Labelled, Raster, kind="semantic_points"):
    """Points of a scan with their classes: (sectors + count, 3) int16 of x, y, class.

    The first ``sectors`` rows are a landmark of each sector, a point of a building, a fence, a
    trunk, a pole or a sign: the nearest to the sensor, or the last of the scan, as ``sector_point``
    says. ``count`` rows follow: one point for each quarter of a polar cell, of the highest
    `PRIORITY` in it, first the best of each whole cell, so that the classes of the cells are those
    of the whole scan as long as they are at most ``count``. Rows of class 0 hold no point.
    Coordinates are in units of ``radius`` / 32767, 1.5 mm.

    The published code keeps all points of a scan, since it moves them before they are cells.
    """

    sectors: int = 360
    rings: int = 50  # of the polar cells
    radius: float = 50.0
    count: int = 12288
    sector_point: SectorPoint = "nearest"
    preprocessing: Preprocessing = field(default_factory=all_points)

    axes = ("point", "xyc")
    dtype = np.dtype(np.int16)

    def __post_init__(self) -> None:
        self.check_counts("sectors", "rings")
        checks.count("raster.count", self.count, most=2**17)
        checks.one_of("raster.sector_point", self.sector_point, SectorPoint)
        self.check_lengths("radius")
        self.check_reach(self.radius)

    @property
    def shape(self) -> tuple[int, int]:
        """Landmarks and points, and 3 for x, y and class."""
        return (self.sectors + self.count, 3)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.int16]:
        """Landmarks and points of points (n, 4): x, y, z, label."""
        classes = classes_of(points[:, 3])
        flat = coordinates(contiguous_points(points))
        landmarks, thinned = self._landmarks(flat, classes), self._thinned(flat, classes)
        image = np.zeros(self.shape, dtype=np.int16)
        rows = np.concatenate([landmarks, thinned])
        filled = np.flatnonzero(rows >= 0)
        taken = rows[filled]
        image[filled, :2] = np.rint(points[taken, :2] * np.float32(FULL / self.radius))
        image[filled, 2] = classes[taken]
        return image

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """Points (n, sectors + count, 3) turned about z by so many sectors, counter-clockwise.

        Landmarks move to the rows of their new sectors; the other rows keep theirs, which say
        nothing. Coordinates are rounded again. Scans with more cells than ``count`` would have kept
        other points of these.
        """
        turn = sectors.double()[:, None] * (2 * math.pi / self.sectors)
        x, y = images[..., 0].double(), images[..., 1].double()
        moved = images.clone()
        moved[..., 0] = (turn.cos() * x - turn.sin() * y).round().to(images.dtype)
        moved[..., 1] = (turn.sin() * x + turn.cos() * y).round().to(images.dtype)
        rows = (torch.arange(self.sectors)[None] - sectors[:, None]) % self.sectors
        landmarks = moved[:, : self.sectors]
        moved[:, : self.sectors] = landmarks.gather(1, rows[..., None].expand_as(landmarks))
        return moved

    def _landmarks(
        self, flat: NDArray[np.float32], classes: NDArray[np.uint8]
    ) -> NDArray[np.int32]:
        """Which point is the landmark of each sector (sectors,), or -1."""
        from deepring.rasters import _semantic_kernels as _kernels

        chosen = np.full(self.sectors, -1, dtype=np.int32)
        nearest = self.sector_point == "nearest"
        _kernels.point_of_sector(flat, LANDMARKS[classes], self.radius, nearest, chosen)
        return chosen

    def _thinned(self, flat: NDArray[np.float32], classes: NDArray[np.uint8]) -> NDArray[np.int32]:
        """Which points (at most count,) stand for the scan."""
        from deepring.rasters import _semantic_kernels as _kernels

        priority = PRIORITY[classes]
        parts = np.full((self.sectors * _FINER, self.rings * _FINER), -1, dtype=np.int32)
        _kernels.first_of_highest(flat, priority, self.radius, parts)
        quarters = parts.reshape(self.sectors, _FINER, self.rings, _FINER).swapaxes(1, 2)
        of_cell = quarters.reshape(-1, _FINER**2)
        ranks = np.append(priority, np.uint8(0))  # -1, where there is no point, takes the last
        best = ranks[of_cell].argmax(axis=1)
        first = of_cell[np.arange(len(of_cell)), best]
        others = np.where(np.arange(_FINER**2) == best[:, None], -1, of_cell).ravel()
        others = others[others >= 0]
        others = others[np.argsort(-priority[others].astype(np.int16), kind="stable")]
        return np.concatenate([first[first >= 0], others])[: self.count]
