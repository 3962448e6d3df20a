"""Exact correlation with all places of a map, or with some: compiled on a CPU, else in torch."""

import torch
from torch import Tensor

from deepring.search.block_store import BlockStore
from deepring.search.hits import Best
from deepring.search.spectra import STEP, Spectra, best_shift, rest_of, waves

#: Floats of correlation curves that the torch form holds at once.
_CURVES = 2**24

_NAMES = Spectra._fields


def compiled(
    places: BlockStore, planes: Tensor, rows: int, k: int, which: Tensor | None = None
) -> Best:
    """The ``k`` best of all places, or of those numbered ``which`` (n,) in ascending order.

    Args:
        places: rows of `Spectra` in memory.
        planes: queries (q, f, 2, w), see `deepring.search.spectra.spectrum_planes`.
        rows: θ of the descriptors.
        k: places wanted.
        which: places to compare with; None takes all.
    """
    from deepring.search import _correlation_kernels as _kernels

    score = torch.full((len(planes), k), torch.finfo().min)
    place, shift = torch.full((2, len(planes), k), -1, dtype=torch.int64)
    wave, queries, rest_of_queries = waves(rows).numpy(), planes.numpy(), rest_of(planes, rows)
    first = 0
    for block in places.blocks():
        values, scale, rest = (block[name] for name in _NAMES)
        if values.dtype == torch.bfloat16:  # which NumPy does not know
            values = values.view(torch.uint16)
        end = first + len(values)
        some = (
            torch.arange(first, end) if which is None else which[(which >= first) & (which < end)]
        )
        numbers = (some - first).numpy()
        arrays = (values.numpy(), scale.numpy(), rest.numpy(), numbers, first, wave, STEP)
        found = (score.numpy(), place.numpy(), shift.numpy())
        _kernels.search(queries, rest_of_queries.numpy(), *arrays, *found)
        first = end
    there = min(k, first if which is None else len(which))
    best = Best(len(planes), k)
    best.score, best.place, best.shift = (t[:, :there] for t in (score, place, shift))
    return best


def batched(
    places: BlockStore, planes: Tensor, rows: int, k: int, which: Tensor | None = None
) -> Best:
    """`compiled` in plain torch, on the device of the places."""
    best = Best(len(planes), k, planes.device)
    if which is not None:
        score, shift = best_shift(planes, Spectra(*places.take(which, *_NAMES)), rows)
        best.see(score, which, shift)
        return best
    size = max(16, _CURVES // max(1, len(planes) * rows))
    for start, part in places.chunks(size, *_NAMES):
        score, shift = best_shift(planes, Spectra(*part), rows)
        best.see(score, torch.arange(start, start + score.shape[1], device=planes.device), shift)
    return best
