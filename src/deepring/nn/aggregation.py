"""From the feature map to the descriptor: aggregation over τ (paper, Sec. III-B and VI-D).

Each maps E_f (b, c, θ, τ) to (b, θ, m), one row of features per direction. All but
`cross_spectra` are the paper's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from deepring.checks import count, is_number, one_of
from deepring.core.correlation import unit_norm
from deepring.core.spectrum import (
    column_dft_magnitude,
    cross_spectrum,
    row_dft,
    row_dft_magnitude,
)
from deepring.errors import ConfigError


def dft(
    feature: Float[Tensor, "batch channel theta tau"],
) -> Float[Tensor, "batch theta value"]:
    """Row-wise DFT magnitude, invariant to translation."""
    return _rows(row_dft_magnitude(feature))


def dft2(
    feature: Float[Tensor, "batch channel theta tau"],
) -> Float[Tensor, "batch theta value"]:
    """A second DFT magnitude, along θ, invariant to rotation too: rows are no longer directions."""
    return column_dft_magnitude(dft(feature))


def cross_spectra(
    feature: Float[Tensor, "batch channel theta tau"], gaps: Sequence[int], frequencies: int
) -> Float[Tensor, "batch theta value"]:
    """Row-wise DFT magnitude, and beside it the phases between directions ``gaps`` rows apart.

    The magnitude knows what stands around a place, the phases also how it stands to each other, as
    far as the sensor has moved little; see `deepring.core.spectrum.cross_spectrum`. The first
    ``frequencies`` of each, without the constant one in the phases, whose real parts precede the
    imaginary ones. Magnitude and phases of each gap have the same norm.
    """
    spectrum = row_dft(feature)[..., : frequencies + 1]
    parts = [_rows(spectrum.abs())]
    for between in gaps:
        pair = cross_spectrum(spectrum[..., 1:], between)
        parts.append(_rows(torch.cat([pair.real, pair.imag], dim=-1)))
    return torch.cat([unit_norm(part) for part in parts], dim=-1)


def _rows(
    values: Float[Tensor, "batch channel theta value"],
) -> Float[Tensor, "batch theta channel*value"]:
    """The values of all channels in one row for each direction."""
    return values.transpose(1, 2).flatten(2)


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


PAPER: dict[str, Callable[[Tensor], Tensor]] = {
    "dft": dft,
    "dft2": dft2,
    "gap": gap,
    "gmp": gmp,
    "multi_gap": gap,
}
"""The paper's aggregations."""

AGGREGATIONS = (*PAPER, "cross_spectra")
"""The names of all aggregations."""

ROTATION_INVARIANT = ("dft2",)
"""Aggregations whose rows are not directions, so that comparison needs no search over rotations."""


@dataclass(frozen=True)
class Aggregation:
    """An aggregation for feature maps of one size."""

    function: Callable[[Tensor], Tensor]
    """(b, channels, θ, τ) -> (b, θ, values)."""
    channels: int
    """Channels of the feature map: multi-GAP has as many values per row as the DFT."""
    values: int
    """Values per direction."""


def make_aggregation(
    kind: str,
    rows: int,
    bins: int,
    gaps: Sequence[float] | None = None,
    frequencies: int | None = None,
) -> Aggregation:
    """The aggregation of feature maps (b, c, ``rows``, ``bins``) over a full turn or half of it.

    Args:
        kind: one of `AGGREGATIONS`.
        rows: directions θ.
        bins: bins of τ.
        gaps: degrees between the two directions of a pair, each a multiple of the step between
            rows of a full turn; for 'cross_spectra' alone.
        frequencies: those of the pairs, and of the magnitudes with one more, the constant; for
            'cross_spectra' alone.

    Raises:
        ConfigError: an unknown kind, or other gaps and frequencies than the kind takes.
    """
    one_of("aggregation.kind", kind, AGGREGATIONS)
    half = bins // 2 + 1
    if kind == "cross_spectra":
        between = _gaps_in_rows(gaps, rows)
        number = _frequencies(frequencies, bins)
        function = partial(cross_spectra, gaps=between, frequencies=number)
        return Aggregation(function, 1, number + 1 + 2 * number * len(between))
    for name, value in {"gaps": gaps, "frequencies": frequencies}.items():
        if value is not None:
            raise ConfigError(
                f"aggregation.{name}: {value!r}, expected null: {kind!r} compares no directions "
                "with each other; take aggregation.kind: 'cross_spectra'"
            )
    channels = half if kind == "multi_gap" else 1
    return Aggregation(PAPER[kind], channels, half if kind in ("dft", "dft2") else channels)


def _gaps_in_rows(gaps: Sequence[float] | None, rows: int) -> tuple[int, ...]:
    step = 360 / rows
    between = [] if gaps is None else [gap / step for gap in gaps if is_number(gap)]
    given = gaps is not None and 0 < len(between) == len(gaps)
    whole = tuple(round(gap) for gap in between)
    exact = all(abs(gap - k) < 1e-6 for gap, k in zip(between, whole, strict=True))
    if not (given and exact and all(0 < 2 * k <= rows for k in whole)):
        raise ConfigError(
            f"aggregation.gaps: {gaps!r}, expected degrees up to 180, multiples of {step:g}, the "
            f"step between the {rows} directions; choose gaps such as [{2 * step:g}, {4 * step:g}]"
        )
    return whole


def _frequencies(frequencies: int | None, bins: int) -> int:
    most = bins // 2
    if frequencies is None:
        raise ConfigError(f"aggregation.frequencies: null, expected a number from 1 to {most}")
    return count("aggregation.frequencies", frequencies, most=most)
