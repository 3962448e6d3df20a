"""From the feature map to the descriptor: aggregation over τ (paper, Sec. III-B and VI-D).

Each maps E_f (b, c, θ, τ) to (b, θ, m), one row of features per direction.
"""

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from deepring.core.spectrum import column_dft_magnitude, row_dft_magnitude


def dft(
    feature: Float[Tensor, "batch channel theta tau"],
) -> Float[Tensor, "batch theta value"]:
    """Row-wise DFT magnitude, invariant to translation."""
    magnitude = row_dft_magnitude(feature)
    return magnitude.transpose(1, 2).flatten(2)


def dft2(
    feature: Float[Tensor, "batch channel theta tau"],
) -> Float[Tensor, "batch theta value"]:
    """A second DFT magnitude, along θ, invariant to rotation too: rows are no longer directions."""
    return column_dft_magnitude(dft(feature))


def gap(
    feature: Float[Tensor, "batch channel theta tau"],
) -> Float[Tensor, "batch theta channel"]:
    """Global average over τ, one value per channel."""
    return feature.mean(dim=-1).transpose(1, 2)


def gmp(
    feature: Float[Tensor, "batch channel theta tau"],
) -> Float[Tensor, "batch theta channel"]:
    """Global maximum over τ, one value per channel."""
    return feature.amax(dim=-1).transpose(1, 2)


AGGREGATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "dft": dft,
    "dft2": dft2,
    "gap": gap,
    "gmp": gmp,
    "multi_gap": gap,
}

ROTATION_INVARIANT = ("dft2",)
"""Aggregations whose rows are not directions, so that comparison needs no search over rotations."""


def channels_for(aggregation: str, bins: int) -> int:
    """Channels of the last convolution: multi-GAP has as many values per row as the DFT."""
    return bins // 2 + 1 if aggregation == "multi_gap" else 1
