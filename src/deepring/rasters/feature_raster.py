"""RING++'s input: six images from above, of the features of the points' neighbourhoods."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DeepringError
from deepring.rasters.bev import disc_mask
from deepring.rasters.downsample import voxel_means
from deepring.rasters.local_features import FEATURES, local_features
from deepring.rasters.preprocessing import Preprocessing
from deepring.rasters.raster_checks import check_crop, check_fields

#: The published code divides x and y by 70 m and z by 19 m before it looks for neighbours.
STRETCH = 70.0 / 19.0


@dataclass(frozen=True)
class FeatureBevRaster:
    """The largest of each local feature in a pillar, masked to the inscribed disc.

    Cells and mask are those of `deepring.rasters.bev.bev_occupancy`; empty cells hold 0, which no
    feature is below. The points are reduced to the means of voxels of ``voxel`` metres, their
    heights multiplied by ``stretch``, and the features taken of their ``neighbours`` nearest
    (`deepring.rasters.local_features`), in stretched metres. The published code (lus6-Jenny/RING)
    stretches alike and takes every point; here what a scan costs is bounded, and places are
    sampled alike near and far.
    """

    cells: int = 120
    extent: float = 70.0
    neighbours: int = 30
    voxel: float = 0.3
    stretch: float = STRETCH
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    def __post_init__(self) -> None:
        check_fields(self, ("cells", "neighbours"), ("extent", "voxel"))
        check_crop(self, self.extent)
        if self.neighbours < 3:
            raise DeepringError(f"raster.neighbours: {self.neighbours}, expected at least 3")
        if not 0 < self.stretch < np.inf:
            raise DeepringError(
                f"raster.stretch: {self.stretch!r}, expected a factor of heights above 0; 1 keeps "
                "them as they are"
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """(feature, x, y)."""
        return (len(FEATURES), self.cells, self.cells)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Half precision: three digits of each feature."""
        return np.dtype(np.float16)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.float16]:
        """Largest features, (6, cells, cells) float16."""
        image = np.zeros((len(FEATURES), self.cells**2))
        kept = self.preprocessing(points, ground_z)
        if len(kept):
            # Sorted, so that sums, and ties between neighbours, do not know the points' order.
            means = voxel_means(kept[np.lexsort(kept.T[::-1])], self.voxel)
            features = local_features(means * [1.0, 1.0, self.stretch], self.neighbours)
            x, y = np.floor((means[:, :2] + self.extent) * (self.cells / (2 * self.extent))).T
            inside = (x >= 0) & (y >= 0) & (x < self.cells) & (y < self.cells)
            cell = (x * self.cells + y)[inside].astype(np.int64)
            for channel, values in zip(image, features[inside].T, strict=True):
                np.maximum.at(channel, cell, values)
        largest = image.reshape(self.shape) * disc_mask(self.cells)
        return np.minimum(largest, np.finfo(np.float16).max).astype(np.float16)
