"""The pose of one scan in another's frame, from their bird's-eye images.

The query is turned by each of a few turns, and a correlation over translations tells where it fits
best. Spectra are half whitened: divided by the root of their size, which sharpens the peak that
occupancy alone leaves broad. The height of the peak says how well the two fit.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError, DataError

#: Cells along a side of an image or of its transform.
_LARGEST = 2048


@dataclass(frozen=True)
class AlignmentSettings:
    """Settings for images of ``cells`` x ``cells`` over [-extent, extent] metres."""

    cells: int = 120
    extent: float = 70.0
    padded: int = 160
    """Side of the transform: shifts up to ``padded - cells`` cells do not wrap."""
    blur: float = 0.6
    """Deviation of a Gaussian, metres."""
    reach: float = 40.0
    """Largest shift along x and y, metres."""
    step: float = math.radians(3.0)
    """Each turn is also tried smaller and larger by this, radians."""

    def __post_init__(self) -> None:
        checks.count("alignment.cells", self.cells, most=_LARGEST)
        if checks.count("alignment.padded", self.padded, self.cells, _LARGEST) % 2:
            raise ConfigError(f"alignment.padded: {self.padded}, expected an even number")
        for name in ("extent", "blur", "reach"):
            value = checks.positive(f"alignment.{name}", getattr(self, name), "metres")
            checks.between(f"alignment.{name}", value, 0, 10_000, "metres")
        checks.between("alignment.step", self.step, math.radians(0.05), math.pi, "radians")

    @property
    def cell(self) -> float:
        """Side of a cell, metres."""
        return 2 * self.extent / self.cells

    @property
    def shifts(self) -> int:
        """Largest shift in cells."""
        return min(self.padded // 2 - 1, math.ceil(self.reach / self.cell))


class Alignment(NamedTuple):
    """Pose of a query in the frames of n map scans."""

    score: Tensor
    """(n,) height of the correlation's peak, at most 1."""
    turn: Tensor
    """(n,) radians in [-π, π), the turn of the points from map scan to query."""
    position: Tensor
    """(n, 2) metres, of the query's sensor in the map scan's frame."""


def occupied_cells(image: Tensor, settings: AlignmentSettings) -> Tensor:
    """Centres (m, 2), metres, of the occupied cells of an image (cells, cells)."""
    if image.shape != (settings.cells, settings.cells):
        raise DataError(
            f"image: shape {tuple(image.shape)}, expected ({settings.cells}, {settings.cells}), "
            "as alignment.cells states"
        )
    return (image.nonzero().float() + 0.5) * settings.cell - settings.extent


def half_whitened(images: Tensor, settings: AlignmentSettings) -> Tensor:
    """Spectra (n, padded, padded // 2 + 1) of images (n, cells, cells).

    They are blurred, without the mean, divided by the root of their sizes, and of unit norm over
    all frequencies.
    """
    spectrum = torch.fft.rfft2(images.float(), s=(settings.padded, settings.padded))
    spectrum = spectrum * _gaussian(settings).to(images.device)
    size = spectrum.abs()
    spectrum = spectrum / size.sqrt().clamp_min(1e-12)
    # After it |spectrum|² is the size; all but the first and last column stand for two.
    power = size.sum(dim=(-2, -1)) * 2 - size[..., 0].sum(-1) - size[..., -1].sum(-1)
    return spectrum / power.sqrt().clamp_min(1e-12)[..., None, None]


def align(cells: Tensor, spectra: Tensor, turns: Tensor, settings: AlignmentSettings) -> Alignment:
    """Align one query with n map scans.

    Args:
        cells: (m, 2) occupied cells of the query, metres, see `occupied_cells`.
        spectra: (n, ...) of the map scans, see `half_whitened`.
        turns: (n, y) radians, turns of the points from map scan to query that are tried, each
            also one ``step`` smaller and larger. A descriptor that cannot tell a turn from its
            opposite gives both.
        settings: images and transforms.
    """
    offsets = settings.step * torch.tensor([-1.0, 0.0, 1.0], device=turns.device)
    trial_turns = turns[..., None] + offsets  # (n, y, 3)
    heights = _correlate(cells, spectra[:, None, None], trial_turns, settings).amax(dim=(-2, -1))
    which = heights.amax(dim=-1).argmax(dim=-1)  # (n,)
    rows = torch.arange(len(turns), device=turns.device)
    turn = turns[rows, which] + settings.step * _vertex(*heights[rows, which].unbind(dim=-1))
    score, shift = _peak(_correlate(cells, spectra, turn, settings))
    return Alignment(
        score, torch.remainder(turn + math.pi, 2 * math.pi) - math.pi, shift * settings.cell
    )


def turned_images(cells: Tensor, turns: Tensor, settings: AlignmentSettings) -> Tensor:
    """Images (..., cells, cells) float32 of the cells (m, 2) turned by -turn (...): back into the
    heading of the map scan. Each cell is shared among the four that it falls between."""
    n = settings.cells
    cosine, sine = torch.cos(turns)[..., None], torch.sin(turns)[..., None]
    x = (cosine * cells[:, 0] + sine * cells[:, 1] + settings.extent) / settings.cell - 0.5
    y = (cosine * cells[:, 1] - sine * cells[:, 0] + settings.extent) / settings.cell - 0.5
    i, j = x.floor(), y.floor()
    u, v = x - i, y - j
    image = torch.zeros(turns.numel(), (n + 2) * (n + 2), device=cells.device)
    for di, share_i in ((0, 1 - u), (1, u)):
        for dj, share_j in ((0, 1 - v), (1, v)):
            # A border of one cell takes what falls off.
            row, column = (i + di).clamp(-1, n) + 1, (j + dj).clamp(-1, n) + 1
            index = (row * (n + 2) + column).long().flatten(0, -2)
            image.scatter_add_(1, index, (share_i * share_j).flatten(0, -2))
    inner = image.view(-1, n + 2, n + 2)[:, 1:-1, 1:-1]
    return inner.reshape(*turns.shape, n, n)


def _correlate(
    cells: Tensor, spectra: Tensor, turns: Tensor, settings: AlignmentSettings
) -> Tensor:
    """Correlation (..., 2r + 1, 2r + 1) over shifts in cells, up to r along x and y."""
    query = half_whitened(turned_images(cells, turns, settings), settings)
    side = settings.padded
    curves = torch.fft.irfft2(spectra * query.conj(), s=(side, side)) * side**2
    reach = settings.shifts
    window = curves.roll((reach, reach), dims=(-2, -1))
    return window[..., : 2 * reach + 1, : 2 * reach + 1]


def _peak(curves: Tensor) -> tuple[Tensor, Tensor]:
    """Height (n,) and place (n, 2), in cells from the middle, of the peaks of (n, s, s)."""
    side = curves.shape[-1]
    height, flat = curves.flatten(1).max(dim=1)
    i = (flat // side).clamp(1, side - 2)
    j = (flat % side).clamp(1, side - 2)
    rows = torch.arange(len(curves), device=curves.device)
    along_x = _vertex(*(curves[rows, i + d, j] for d in (-1, 0, 1)))
    along_y = _vertex(*(curves[rows, i, j + d] for d in (-1, 0, 1)))
    return height, torch.stack([i + along_x, j + along_y], dim=1) - side // 2


def _vertex(before: Tensor, middle: Tensor, after: Tensor) -> Tensor:
    """Peak of the parabola through three values, in steps from the middle, in [-1, 1]."""
    bend = (2 * middle - before - after).clamp_min(1e-12)
    # Where the middle is not the largest the vertex lies outside, or is a minimum.
    return ((after - before) / (2 * bend)).clamp(-1.0, 1.0)


@lru_cache
@torch.inference_mode(False)
def _gaussian(settings: AlignmentSettings) -> Tensor:
    """The blur's transfer function (padded, padded // 2 + 1), without the mean."""
    side = settings.padded
    along = torch.fft.fftfreq(side)[:, None], torch.fft.rfftfreq(side)[None]
    squared = along[0].square() + along[1].square()
    deviation = settings.blur / settings.cell
    transfer = torch.exp(-2 * (math.pi * deviation) ** 2 * squared)
    transfer[0, 0] = 0.0
    return transfer
