"""Exact correlation with all or some places: compiled on a CPU, otherwise in torch."""

import torch
from jaxtyping import Float32, Int64
from torch import Tensor

from deepring.search.block_store import BlockStore
from deepring.search.hits import Best
from deepring.search.spectra import TAIL_STEP, Spectra, best_shift, idft_basis, tail_norms

#: Floats of correlation curves that `batched` holds at once.
_CURVES = 2**24

_NAMES = Spectra._fields


def compiled(
    places: BlockStore,
    queries: Float32[Tensor, "q k 2 w"],
    rows: int,
    k: int,
    which: Int64[Tensor, " n"] | None = None,
) -> Best:
    """The ``k`` best of all places, or of the places ``which`` (n,), ascending numbers.

    Args:
        places: rows of `Spectra`.
        queries: (q, k, 2, w) spectra, see `deepring.search.spectra.padded_spectra`.
        rows: rows θ of the descriptors.
        k: number of places per query.
        which: numbers of the places to compare with; None compares with all.
    """
    from deepring.search import _correlation_kernels as _kernels

    score = torch.full((len(queries), k), torch.finfo().min)
    place, shift = torch.full((2, len(queries), k), -1, dtype=torch.int64)
    best = (score.numpy(), place.numpy(), shift.numpy())
    spectra = (queries.numpy(), tail_norms(queries, rows).numpy())
    basis = idft_basis(rows).numpy()
    first = 0
    for block in places.blocks():
        values, scale, tails = (block[name] for name in _NAMES)
        if values.dtype == torch.bfloat16:  # unknown to NumPy
            values = values.view(torch.uint16)
        end = first + len(values)
        part = (
            torch.arange(first, end) if which is None else which[(which >= first) & (which < end)]
        )
        numbers = (part - first).numpy()
        arrays = (values.numpy(), scale.numpy(), tails.numpy(), numbers, first, basis, TAIL_STEP)
        _kernels.search(*spectra, *arrays, *best)
        first = end
    top = Best(len(queries), k)
    size = min(k, first if which is None else len(which))
    top.score, top.place, top.shift = (t[:, :size] for t in (score, place, shift))
    return top


def batched(
    places: BlockStore,
    queries: Float32[Tensor, "q k 2 w"],
    rows: int,
    k: int,
    which: Int64[Tensor, " n"] | None = None,
) -> Best:
    """`compiled` in plain torch, on the device of the places."""
    best = Best(len(queries), k, queries.device)
    if which is not None:
        score, shift = best_shift(queries, Spectra(*places.take(which, *_NAMES)), rows)
        best.update(score, which, shift)
        return best
    size = max(16, _CURVES // max(1, len(queries) * rows))
    for start, part in places.chunks(size, *_NAMES):
        score, shift = best_shift(queries, Spectra(*part), rows)
        best.update(
            score, torch.arange(start, start + score.shape[1], device=queries.device), shift
        )
    return best
