"""RING++'s input: six bird's-eye images of features of the points' neighbourhoods."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.rasters.base import Raster
from deepring.rasters.bev import disc_mask
from deepring.rasters.downsample import voxel_means
from deepring.rasters.local_features import FEATURES, local_features
from deepring.rasters.preprocessing import Preprocessing

#: The published code divides x and y by 70 m and z by 19 m before it looks for neighbours.
STRETCH = 70.0 / 19.0


@dataclass(frozen=True)
class FeatureBevRaster(Raster, kind="features"):
    """The largest of each local feature in a pillar, masked to the inscribed disc.

    Cells and mask are those of `deepring.rasters.bev.bev_occupancy`; empty cells are 0, and no
    feature is negative. The points are reduced to the means of voxels of ``voxel`` metres, their
    heights are multiplied by ``stretch``, and features are computed over the ``neighbours``
    nearest points (`deepring.rasters.local_features`), in stretched metres. The published code
    (lus6-Jenny/RING) stretches too but uses every point; voxels bound the cost of a scan and
    sample near and far places equally densely.

    >>> FeatureBevRaster(cells=40).shape
    (6, 40, 40)
    """

    cells: int = 120  # along a side
    extent: float = 70.0  # metres, half a side
    neighbours: int = 30
    voxel: float = 0.3
    stretch: float = STRETCH
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("feature", "x", "y")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("cells")
        self.check_lengths("extent", "voxel")
        self.check_reach(self.extent)
        checks.count("raster.neighbours", self.neighbours, least=3)
        checks.positive("raster.stretch", self.stretch)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Features, and cells along x and y."""
        return (len(FEATURES), self.cells, self.cells)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Largest features, (6, cells, cells) float16."""
        image = np.zeros((len(FEATURES), self.cells**2))
        if len(points):
            # Sorted, so that sums and ties do not depend on the order of the points.
            means = voxel_means(points[np.lexsort(points.T[::-1])], self.voxel)
            features = local_features(means * [1.0, 1.0, self.stretch], self.neighbours)
            x, y = np.floor((means[:, :2] + self.extent) * (self.cells / (2 * self.extent))).T
            inside = (x >= 0) & (y >= 0) & (x < self.cells) & (y < self.cells)
            cell = (x * self.cells + y)[inside].astype(np.int64)
            for channel, values in zip(image, features[inside].T, strict=True):
                np.maximum.at(channel, cell, values)
        largest = image.reshape(self.shape) * disc_mask(self.cells)
        return np.minimum(largest, np.finfo(np.float16).max).astype(np.float16)
