"""Correlation of a turned bird's-eye image with others, over translations.

On a CPU images are drawn, spectra whitened and peaks found in compiled loops; elsewhere in plain
torch, with which the loops agree.
"""

import math
from collections.abc import Iterator
from functools import lru_cache

import torch
from torch import Tensor

from deepring.errors import DataError
from deepring.localization.alignment.settings import AlignmentSettings

#: Numbers of the transforms that are held at a time, half a megabyte: they stay in the processor's
#: cache, and the system hands out no new memory for each query.
_HELD = 2**17

#: Turns closer to each other are the same but for rounding, radians.
_SAME = 1e-5


def occupied_cells(image: Tensor, settings: AlignmentSettings) -> Tensor:
    """Centres (m, 2), metres, of the occupied cells of an image (cells, cells)."""
    if image.shape != (settings.cells, settings.cells):
        raise DataError(
            f"image: shape {tuple(image.shape)}, expected ({settings.cells}, {settings.cells}), "
            "as alignment.cells states"
        )
    return (image.nonzero().float() + 0.5) * settings.cell - settings.extent


def turned_images(cells: Tensor, turns: Tensor, settings: AlignmentSettings) -> Tensor:
    """Images (..., cells, cells) float32 of the cells (m, 2) turned by -turn (...): back into the
    heading of the map scan. Each cell is shared among the four that it falls between."""
    n, cosine, sine = settings.cells, torch.cos(turns), torch.sin(turns)
    if not _compiled(turns):
        x = cosine[..., None] * cells[:, 0] + sine[..., None] * cells[:, 1]
        y = cosine[..., None] * cells[:, 1] - sine[..., None] * cells[:, 0]
        x, y = ((v + settings.extent) / settings.cell - 0.5 for v in (x, y))
        return _drawn(x.flatten(0, -2), y.flatten(0, -2), n).view(*turns.shape, n, n)
    from deepring.localization.alignment import _alignment_kernels as _kernels

    images = torch.zeros(turns.numel(), n, n)
    arrays = (v.float().flatten().numpy() for v in (cosine, sine))
    _kernels.draw(cells.numpy(), *arrays, settings.extent, settings.cell, images.numpy())
    return images.view(*turns.shape, n, n)


def smaller_images(images: Tensor, settings: AlignmentSettings) -> Tensor:
    """Images (k, n, n), 0 or 1, drawn on the cells of ``settings.coarse``: (k, c, c) float32."""
    n, c = settings.cells, settings.coarse.cells
    if not _compiled(images):
        k, i, j = images.nonzero(as_tuple=True)
        x, y = (((v + 0.5 - n / 2) / 2 + c / 2 - 0.5) for v in (i, j))
        return torch.stack(
            [_drawn(x[k == q][None], y[k == q][None], c)[0] for q in range(len(images))]
        )
    from deepring.localization.alignment import _alignment_kernels as _kernels

    smaller = torch.zeros(len(images), c, c)
    _kernels.draw_smaller(images.to(torch.uint8).numpy(), smaller.numpy())
    return smaller


def half_whitened(images: Tensor, settings: AlignmentSettings) -> Tensor:
    """Spectra (n, padded, padded // 2 + 1) of images (n, c, c), c up to ``padded``.

    They are blurred, without the mean, divided by the root of their sizes, and of unit norm over
    all frequencies.
    """
    side = settings.padded
    spectra = torch.empty(
        len(images), side, side // 2 + 1, dtype=torch.complex64, device=images.device
    )
    for part in _parts(len(images), settings):
        torch.fft.rfft2(images[part].float(), s=(side, side), out=spectra[part])
    transfer = _gaussian(settings).to(spectra.device)
    if _compiled(spectra):
        from deepring.localization.alignment import _alignment_kernels as _kernels

        arrays = (transfer.flatten().numpy(), _times(side).numpy())
        _kernels.half_whiten(spectra.flatten(1).numpy(), *arrays)
        return spectra
    spectra = spectra * transfer
    size = spectra.abs()
    spectra = spectra / size.sqrt().clamp_min(1e-12)
    # After it |spectrum|² is the size.
    power = (size.flatten(1) * _times(side).to(size.device)).sum(dim=1)
    return spectra / power.sqrt().clamp_min(1e-12)[..., None, None]


def best_fits(
    cells: Tensor, spectra: Tensor, turns: Tensor, settings: AlignmentSettings
) -> tuple[Tensor, Tensor]:
    """Where the query, turned by turns (n, ...), fits each of n map scans best.

    Args:
        cells: (m, 2) occupied cells of the query, metres.
        spectra: (n, ...) of the map scans, see `half_whitened`.
        turns: (n, ...) radians.
        settings: images and transforms.

    Returns the heights (...) of the correlations' peaks, and their shifts (..., 2) in cells.
    """
    # Turns are multiples of a descriptor's step, and the query is turned once for all map scans;
    # half a turn more is the same image seen from behind.
    halves = (turns / math.pi).floor()
    distinct, which = torch.unique(
        ((turns - halves * math.pi) / _SAME).round(), return_inverse=True
    )
    queries = half_whitened(turned_images(cells, distinct * _SAME, settings), settings)
    rows = torch.arange(len(turns), device=turns.device)
    rows = rows.repeat_interleave(which[0].numel())
    pairs = torch.stack([rows, which.flatten(), (halves % 2).long().flatten()], dim=1)
    height, shift = turns.new_empty(len(pairs)), turns.new_empty(len(pairs), 2)
    for part in _parts(len(pairs), settings):
        curves = correlations(spectra, queries, pairs[part], settings)
        height[part], shift[part] = peaks(curves, settings)
    return height.view(turns.shape), shift.view(*turns.shape, 2)


def correlations(
    spectra: Tensor, queries: Tensor, pairs: Tensor, settings: AlignmentSettings
) -> Tensor:
    """Correlations (p, padded, padded) of pairs of a map scan and a query.

    A row of ``pairs`` (p, 3) int64 has the number of the map scan, that of the query, and 1 for the
    query turned by half a turn more, 0 otherwise. Correlations are over shifts in cells; negative
    ones are at the ends of the axes.
    """
    side = settings.padded
    behind = _seen_from_behind(settings).to(spectra.device)
    if _compiled(spectra):
        from deepring.localization.alignment import _alignment_kernels as _kernels

        products = spectra.new_empty(len(pairs), side, side // 2 + 1)
        arrays = (v.flatten(1).numpy() for v in (spectra, queries, pairs, products))
        _kernels.multiply(behind.flatten().numpy(), *arrays)
    else:
        half = pairs[:, 2, None, None] == 1
        turned = queries[pairs[:, 1]]
        products = spectra[pairs[:, 0]] * torch.where(half, turned * behind, turned.conj())
    return torch.fft.irfft2(products, s=(side, side), norm="forward")


def peaks(curves: Tensor, settings: AlignmentSettings) -> tuple[Tensor, Tensor]:
    """Heights (p,) and shifts (p, 2), in cells, of the peaks of `correlations` (p, s, s).

    Shifts reach up to ``settings.shifts`` along each axis, and are refined by parabolas.
    """
    if not _compiled(curves):
        return _plain_peaks(curves, settings.shifts)
    from deepring.localization.alignment import _alignment_kernels as _kernels

    height, shift = torch.empty(len(curves)), torch.empty(len(curves), 2)
    _kernels.peaks(curves.numpy(), settings.shifts, height.numpy(), shift.numpy())
    return height, shift


def vertex(before: Tensor, middle: Tensor, after: Tensor) -> Tensor:
    """Peak of the parabola through three values, in steps from the middle, in [-1, 1]."""
    bend = (2 * middle - before - after).clamp_min(1e-12)
    # Where the middle is not the largest the vertex lies outside, or is a minimum.
    return ((after - before) / (2 * bend)).clamp(-1.0, 1.0)


def _parts(count: int, settings: AlignmentSettings) -> Iterator[slice]:
    """Slices of so many transforms that are held at a time."""
    size = max(1, _HELD // settings.padded**2)
    return (slice(first, first + size) for first in range(0, count, size))


def _compiled(tensor: Tensor) -> bool:
    """Whether compiled loops take the tensor."""
    return tensor.device.type == "cpu"


def _drawn(x: Tensor, y: Tensor, n: int) -> Tensor:
    """Images (t, n, n) of points (t, m), in cells from the middle of the first, in plain torch."""
    i, j = x.floor(), y.floor()
    u, v = x - i, y - j
    image = torch.zeros(len(x), (n + 2) * (n + 2), device=x.device)
    for di, share_i in ((0, 1 - u), (1, u)):
        for dj, share_j in ((0, 1 - v), (1, v)):
            # A border of one cell takes what falls off.
            row, column = (i + di).clamp(-1, n) + 1, (j + dj).clamp(-1, n) + 1
            index = (row * (n + 2) + column).long()
            image.scatter_add_(1, index, share_i * share_j)
    return image.view(-1, n + 2, n + 2)[:, 1:-1, 1:-1]


def _plain_peaks(curves: Tensor, reach: int) -> tuple[Tensor, Tensor]:
    """Heights (n,) and shifts (n, 2) of the peaks of (n, s, s), in plain torch."""
    side = 2 * reach + 1
    window = curves.roll((reach, reach), dims=(-2, -1))[..., :side, :side]
    height, flat = window.flatten(1).max(dim=1)
    i = (flat // side).clamp(1, side - 2)
    j = (flat % side).clamp(1, side - 2)
    rows = torch.arange(len(curves), device=curves.device)
    along_x = vertex(*(window[rows, i + d, j] for d in (-1, 0, 1)))
    along_y = vertex(*(window[rows, i, j + d] for d in (-1, 0, 1)))
    return height, torch.stack([i + along_x, j + along_y], dim=1) - reach


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


@lru_cache
@torch.inference_mode(False)
def _times(side: int) -> Tensor:
    """How often each of the side * (side // 2 + 1) frequencies of a half spectrum occurs."""
    columns = torch.full((side // 2 + 1,), 2.0)
    columns[0] = columns[-1] = 1.0
    return columns.repeat(side)


@lru_cache
@torch.inference_mode(False)
def _seen_from_behind(settings: AlignmentSettings) -> Tensor:
    """What makes of a spectrum (padded, padded // 2 + 1) the conjugate one of the same image turned
    by half a turn, whose last cell is the first."""
    side, last = settings.padded, settings.cells - 1
    along = torch.fft.fftfreq(side)[:, None] + torch.fft.rfftfreq(side)[None]
    return torch.exp(2j * math.pi * last * along.double()).to(torch.complex64)
