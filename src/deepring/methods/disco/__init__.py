"""DiSCO (Xu et al., RA-L 2021; MaverickPeter/DiSCO-pytorch)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64, Shaped
from torch import Tensor

from deepring.checks import count, one_of
from deepring.core.correlation import shift_to_turn
from deepring.core.phase import central_magnitude, phase_correlation
from deepring.core.similarity import negative_distance
from deepring.errors import ConfigError
from deepring.methods.disco.disco_unet import DiscoUNet, PolarPadding
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.rasters import HeightRaster, raster_settings
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.vector_index import VectorIndex

Signature = Literal["raw", "unit"]
"""The spectrum as it is, or that of the map without its mean, at unit norm."""


@dataclass(frozen=True)
class DiscoSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints.

    ``size`` is the side of the square cut out of the spectrum. ``signature`` 'raw' is the published
    one; 'unit' leaves out the map's mean and has norm 1, so that margins and temperatures mean the
    same whatever the network's scale. ``aligned`` is the number of the
    most alike entries whose turn is sought for each query; None seeks all.
    """

    label: ClassVar[str] = "DiSCO"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(HeightRaster()))
    widths: Sequence[int] = (64, 128, 256, 512)  # channels of each level of the UNet
    padding: PolarPadding = "zero"  # of θ: zero, as published, or circular
    size: int = 32
    signature: Signature = "raw"
    aligned: int | None = 1


class Disco(NetworkMethod):
    """Polar occupancy (b, heights, θ, r) -> UNet -> feature map (b, θ, r), the descriptor.

    Places are compared by the `signature` of the map, size² numbers (1024). The map itself is
    kept, since its phase holds the turn. A turn of the scan rolls θ; the signature is invariant to
    rolls that the network commutes with: with circular padding exactly to those by the network's
    stride, with the published zero padding only as far as training brings it.
    """

    settings_class = DiscoSettings
    settings: DiscoSettings

    def __init__(self, settings: DiscoSettings | None = None) -> None:
        settings = DiscoSettings() if settings is None else settings
        super().__init__(settings, HeightRaster)
        heights, sectors, rings = self.raster.shape
        if not 1 <= settings.size <= min(sectors, rings):
            raise ConfigError(
                f"disco.size: {settings.size}, expected 1 to {min(sectors, rings)}, the smaller "
                f"side of the raster's {sectors} x {rings}"
            )
        one_of("disco.signature", settings.signature, Signature)
        if settings.aligned is not None:
            count("disco.aligned", settings.aligned)
        self.encoder = DiscoUNet(heights, settings.widths, settings.padding)
        if sectors % self.encoder.stride or rings % self.encoder.stride:
            raise ConfigError(
                f"disco.widths: {len(settings.widths)} levels divide sectors and rings by "
                f"{self.encoder.stride}, expected a divisor of {sectors} x {rings}; choose fewer "
                "levels or other numbers of sectors"
            )

    def forward(
        self, rasters: Shaped[Tensor, "batch height theta r"]
    ) -> Float[Tensor, "batch theta r"]:
        """Feature maps (b, θ, r) of polar occupancy (b, heights, θ, r), 0 or 1 of any type."""
        return self.encoder(rasters.float())

    def signature(
        self, descriptors: Float[Tensor, "*batch theta r"]
    ) -> Float[Tensor, "*batch value"]:
        """The rotation invariant part of the descriptors, (b, size²): what L2 compares."""
        if self.settings.signature == "raw":
            return central_magnitude(descriptors, self.settings.size)
        centred = descriptors.float() - descriptors.float().mean(dim=(-2, -1), keepdim=True)
        return F.normalize(central_magnitude(centred, self.settings.size), dim=-1)

    def vectors(self, descriptors: Float[Tensor, "batch theta r"]) -> Float[Tensor, "batch value"]:
        """The signatures."""
        return self.signature(descriptors)

    def compare(
        self, queries: Float[Tensor, "q theta r"], database: Float[Tensor, "d theta r"]
    ) -> Comparison:
        """Negative Euclidean distance of signatures, and the turn by phase correlation.

        The turn is NaN for entries that are not among the ``aligned`` most alike ones: like the
        original, which aligns what it has retrieved.
        """
        score = negative_distance(self.signature(queries), self.signature(database))
        turn = torch.full_like(score, torch.nan)
        for k, query in enumerate(queries):  # the maps of one query's entries at a time
            nearest = _nearest(score[k], self.settings.aligned)
            turn[k, nearest] = self.align(query, database[nearest])
        return Comparison(score, turn)

    def align(
        self, query: Float[Tensor, "theta r"], entries: Float[Tensor, "d theta r"]
    ) -> Float[Tensor, " d"]:
        """Turn (d,) from each entry (d, θ, r) to one query (θ, r), by phase correlation."""
        return shift_to_turn(phase_correlation(query, entries).shift, query.shape[-2])

    @property
    def descriptor_shape(self) -> tuple[int, int]:
        """(θ, r) of one descriptor."""
        _, sectors, rings = self.raster.shape
        return sectors, rings

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Exhaustive search of signatures, see `index_of`; takes no settings.

        All hits are aligned, whatever ``aligned`` says.
        """
        return VectorIndex("l2", self.vectors, self.align)


def _nearest(score: Float[Tensor, " d"], number: int | None) -> Int64[Tensor, " _"]:
    """Indices of the ``number`` largest of (d,), all where it is None or more than d."""
    if number is None or number >= len(score):
        return torch.arange(len(score), device=score.device)
    # argmax takes the first of equal scores, as retrieval does; topk promises nothing.
    return score.argmax().unsqueeze(0) if number == 1 else score.topk(number).indices
