"""LiDAR-Iris (Wang et al., IROS 2020): a scan's image read as the iris of an eye is."""

from typing import ClassVar

import torch
from jaxtyping import Float, Float32, Shaped
from torch import Tensor

from deepring.checks import of_type
from deepring.core.correlation import Match, correlation_curves, shift_to_turn
from deepring.methods.lidar_iris.iris_code import iris_code, packed, packed_length, unpacked
from deepring.methods.lidar_iris.iris_index import IrisIndex
from deepring.methods.method import Comparison, FixedMethod
from deepring.rasters import IrisRaster
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings

#: Entries, and queries, whose spectra are in memory at once: some 100 MB each.
_BLOCK = 64


class LidarIris(FixedMethod):
    """Signs of log-Gabor responses along the azimuth, compared bit by bit at the best turn.

    Descriptors (b, θ, numbers) are float32, sixteen bits in a number. A turn of the
    scan rolls θ.
    """

    label: ClassVar[str] = "LiDAR-Iris"

    def __init__(self, raster: IrisRaster | None = None) -> None:
        self.raster = of_type("LiDAR-Iris: raster", raster or IrisRaster(), IrisRaster)

    def describe(
        self, rasters: Shaped[Tensor, "batch theta r"]
    ) -> Float[Tensor, "batch theta number"]:
        """Packed codes."""
        return packed(iris_code(rasters))

    def compare(
        self, queries: Float[Tensor, "q theta number"], database: Float[Tensor, "d theta number"]
    ) -> Comparison:
        """The share of bits that agree, of those that count in both, at the best turn.

        In [0, 1], 0 where no bits count in both.
        """
        score, shift = best_agreement(queries, database)
        return Comparison(score, shift_to_turn(shift, queries.shape[-2]))

    @property
    def descriptor_shape(self) -> tuple[int, int]:
        """(θ, numbers) of one descriptor."""
        sectors, rings = self.raster.shape
        return sectors, packed_length(rings)

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Search by compiled loops over the bits, see `index_of`; takes no settings."""
        return IrisIndex()


def best_agreement(
    queries: Float[Tensor, "q theta number"], database: Float[Tensor, "d theta number"]
) -> Match:
    """The share of bits that agree at the best shift, and that shift, of all pairs: (q, d).

    With ±1 for bits that count and 0 for others, S, and 1 or 0 for whether they count, V, the share
    that differs at a shift is ½ (1 - S⋆S / V⋆V), ⋆ the circular correlation: of two whole numbers,
    to which the correlations by FFT are rounded.
    """
    score = torch.zeros(len(queries), len(database), device=queries.device)
    shift = torch.zeros(score.shape, dtype=torch.int64, device=queries.device)
    for column in range(0, len(database), _BLOCK):
        d_signs, d_counts = _signs(database[column : column + _BLOCK])
        for row in range(0, len(queries), _BLOCK):
            q_signs, q_counts = _signs(queries[row : row + _BLOCK])
            agreeing = correlation_curves(q_signs, d_signs).round().double()
            counted = 2 * correlation_curves(q_counts, d_counts).round().double()
            differ = 0.5 * (1 - agreeing / counted.clamp_min(1.0))
            distance = torch.where(counted > 0, differ, 1.0)
            least, where = distance.min(dim=-1)
            block = slice(row, row + _BLOCK), slice(column, column + _BLOCK)
            score[block], shift[block] = (1 - least).float(), where
    return Match(score, shift)


def _signs(
    descriptors: Float[Tensor, "n theta number"],
) -> tuple[Float32[Tensor, "n theta _"], Float32[Tensor, "n theta _"]]:
    """±1 for the bits that count and 0 for others, and whether they count."""
    real, imaginary, counts = unpacked(descriptors)
    weight = counts.float()
    signs = [(2 * bits.float() - 1) * weight for bits in (real, imaginary)]
    return torch.cat(signs, dim=-1), weight
