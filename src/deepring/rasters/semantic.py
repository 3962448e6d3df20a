"""The classes of a scan over polar cells: Semantic Scan Context (Li et al., IROS 2021)."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deepring.rasters.base import Raster
from deepring.rasters.classes import PRIORITY, classes_of
from deepring.rasters.preprocessing import Preprocessing, contiguous_points, coordinates

#: Metres above and below the ground that no scan goes beyond: all points count.
ALL_HEIGHTS = (-1000.0, 1000.0)

#: Class of each priority.
_OF_PRIORITY = np.zeros(int(PRIORITY.max()) + 1, dtype=np.uint8)
_OF_PRIORITY[PRIORITY] = np.where(PRIORITY > 0, np.arange(len(PRIORITY)), 0)


def all_points() -> Preprocessing:
    """All points within 50 m, with the ground."""
    return Preprocessing(height=ALL_HEIGHTS, clearance=None, extent=50.0)


class Labelled:
    """What rasters of points with the labels of SemanticKITTI share."""

    columns: ClassVar[tuple[str, ...]] = ("label",)

    def why_blank(self, points: NDArray[np.floating], ground_z: float) -> str:  # noqa: ARG002
        """That no point is of a class that counts, and which labels there are."""
        labels = sorted({int(label) for label in np.unique(points[:, 3])})
        return (
            f"no point within range is of a class that counts; its labels are {labels[:20]}, "
            "expected SemanticKITTI's numbers, such as 40 for road and 50 for building"
        )


@dataclass(frozen=True)
class SemanticRaster(Labelled, Raster, kind="semantic"):
    """The class of each polar cell: (sectors, rings) uint8, numbers of `CLASSES`, 0 for none.

    Of several classes in a cell that of the highest `PRIORITY` counts. Things that move do not
    count.

    >>> points = np.array([[9.5, 0.1, 0, 40], [9.6, 0.1, 1, 71], [-20.5, 0.1, 1, 252]])
    >>> image = SemanticRaster(sectors=4)(points, ground_z=0.0)
    >>> np.argwhere(image).tolist(), int(image[0, 9])  # a trunk on a road; the car does not count
    ([[0, 9]], 16)
    """

    sectors: int = 360  # equal parts of θ
    rings: int = 50  # equal parts of the radius
    radius: float = 50.0  # metres
    preprocessing: Preprocessing = field(default_factory=all_points)

    axes = ("theta", "r")
    dtype = np.dtype(np.uint8)

    def __post_init__(self) -> None:
        self.check_disc("sectors", "rings")

    @property
    def shape(self) -> tuple[int, int]:
        """Sectors and rings."""
        return (self.sectors, self.rings)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Classes (sectors, rings) of points (n, 4): x, y, z, label."""
        classes = classes_of(points[:, 3])
        return semantic_context(points, classes, self.radius, self.sectors, self.rings)


def semantic_context(
    points: NDArray[np.float32],
    classes: NDArray[np.uint8],
    radius: float = 50.0,
    sectors: int = 360,
    rings: int = 50,
) -> NDArray[np.uint8]:
    """The class of the highest priority in each polar cell, (sectors, rings) uint8.

    Row k covers azimuths 2π [k, k + 1) / sectors, counter-clockwise from x: a turn of the scan
    by +2π / sectors shifts the rows by +1. The published code has azimuths from -π.

    Args:
        points: (n, >=3) float32, metres, finite.
        classes: (n,) numbers of `CLASSES`.
        radius: outer radius, metres.
        sectors: number of rows, over the full turn.
        rings: number of columns, of equal width.
    """
    from deepring.rasters import _semantic_kernels

    image = np.zeros((sectors, rings), dtype=np.uint8)
    flat = coordinates(contiguous_points(points))
    _semantic_kernels.highest_priority(flat, PRIORITY[classes], radius, image)
    return _OF_PRIORITY[image]
