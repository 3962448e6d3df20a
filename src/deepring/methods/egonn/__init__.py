"""EgoNN (Komorowski et al., RA-L 2021; jac99/Egonn), its branch for place recognition."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from deepring.methods.egonn.egonn_network import WIDTHS, EgoNN
from deepring.methods.network import PlainSettings
from deepring.methods.vector_network import VectorNetwork
from deepring.rasters import VoxelRaster, raster_settings


@dataclass(frozen=True)
class EgoNnSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "EgoNN"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(VoxelRaster()))
    widths: Sequence[int] = WIDTHS  # channels of the stem and of each level
    global_levels: Sequence[int] = (5, 6, 7)  # levels that the descriptor is made of
    close_theta: bool = False  # convolutions go on where θ starts again
    normalised: bool = False  # descriptors have unit norm; as published they do not


class EgoNnGlobal(VectorNetwork):
    """Cylindrical voxels (b, max_voxels, 3), padded -> sparse network -> descriptors (b, 256).

    The sparse convolutions are deepring's own, in plain torch; the original's are
    MinkowskiEngine's. The descriptor is not normalised, as in the original; ``normalised`` gives
    it unit norm, so that margins and temperatures mean the same whatever the network's scale.
    """

    settings_class = EgoNnSettings
    settings: EgoNnSettings

    def __init__(self, settings: EgoNnSettings | None = None) -> None:
        settings = EgoNnSettings() if settings is None else settings
        super().__init__(settings, VoxelRaster)
        raster = self.raster
        assert isinstance(raster, VoxelRaster)
        self.network = EgoNN(
            steps=(raster.degrees, raster.ring, raster.height),
            widths=settings.widths,
            global_levels=settings.global_levels,
            close_theta=settings.close_theta,
        )

    def forward(self, rasters: Int[Tensor, "batch n 3"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, 256) float32 of voxel indices (b, max_voxels, 3), integers.

        Raises DeepringError where a scan has no voxel.
        """
        descriptors = self.network(rasters)
        return F.normalize(descriptors, dim=-1) if self.settings.normalised else descriptors

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.network.global_head.size,)
