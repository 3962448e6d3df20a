"""Pairs of scans: the turn and the offset between them, and how alike they are then."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring.rasters.classes import PRIORITY

#: Pairs below which one thread is as fast as several.
_FEW = 64


class PairSettings(NamedTuple):
    """What aligning a pair depends on."""

    sectors: int
    rings: int
    radius: float
    """Metres."""
    match_labels: bool
    """Landmarks are paired within their class."""
    window: int
    """Sectors in which a landmark is looked for, half of them to either side."""


class Alignments(NamedTuple):
    """One query with m entries."""

    score: Float[Tensor, " m"]
    """Share of alike cells, in [0, 1]."""
    roll: Int64[Tensor, " m"]
    """Sectors by which the entry is turned."""
    offset: Float[Tensor, "m 2"]
    """x and y in metres, by which the turned entry is moved."""


def align_query(
    query: Float[Tensor, "point xyc"],
    entries: Float[Tensor, "d point xyc"],
    which: Int64[Tensor, " m"],
    settings: PairSettings,
) -> Alignments:
    """Align a query with the entries of these numbers, on as many threads as torch has."""
    from deepring.methods.ssc import _ssc_kernels

    one, all_of_them = (np.ascontiguousarray(part.numpy()) for part in (query, entries))
    numbers = np.ascontiguousarray(which.numpy())
    found = np.zeros((len(numbers), 4))
    shape = (settings.sectors, settings.rings)
    half = min(settings.window // 2, (settings.sectors - 1) // 2)

    def part(of: slice) -> None:
        _ssc_kernels.align_all(
            *(one, all_of_them, numbers[of], PRIORITY, shape),
            *(settings.radius, settings.match_labels, half, found[of]),
        )

    threads = torch.get_num_threads() if len(numbers) > _FEW else 1
    if threads == 1:
        part(slice(None))
    else:
        step = -(-len(numbers) // threads)
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(part, [slice(k, k + step) for k in range(0, len(numbers), step)]))
    values = torch.from_numpy(found)
    return Alignments(values[:, 0].float(), values[:, 1].long(), values[:, 2:].float())
