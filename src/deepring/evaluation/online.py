"""Online look-up: each query among the places that are old enough, which grow along the drive.

Places are added to the method's own index when the first query may see them, as a robot's would.
So whatever the index, a search is exact over the places that it holds by then, also where it
compares only the nearest by a key; no place is compared that may not be found.
"""

import time
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.errors import DataError
from deepring.evaluation.look_up import EXACT, fill_index, finite, joined, look_up, on_cpu
from deepring.methods.method import Method, index_of
from deepring.search.hits import Hits


def look_up_among(
    method: Method,
    places: Iterable[Tensor],
    queries: Iterable[Tensor],
    k: int,
    searched: NDArray[np.int64] | None,
) -> tuple[Hits, float]:
    """The ``k`` best places of each query, on the CPU, and the seconds per query of the search.

    Args:
        method: the one that made the descriptors.
        places: batches (b, ...) of the database's descriptors, in order, on any device.
        queries: batches (b, ...) of theirs; making them is not timed.
        k: places per query.
        searched: with how many of the first places each query is compared, (q,), at least 1 and
            never falling; None compares each with all.

    Raises:
        DataError: descriptors or scores that are not finite, or other numbers in ``searched``.
    """
    if searched is None:
        return look_up(fill_index(method, places), queries, k)
    if len(searched) and (searched[0] < 1 or (np.diff(searched) < 0).any()):
        raise DataError(
            "searched: numbers of places that fall or are below 1; expected queries in driving "
            "order, each with a place; evaluate again"
        )
    index = index_of(method, EXACT)
    rest = _one_by_one(places)
    hits: list[Hits] = []
    seconds, done = 0.0, 0
    for batch in queries:
        finite("queries", batch)
        for start, end in _runs(searched[done : done + len(batch)]):
            while len(index) < searched[done + start]:
                index.add(next(rest))
            if not hits:
                index.search(batch[start:end], k)  # a first search may compile
            if batch.is_cuda:  # else unfinished work on the GPU is timed
                torch.cuda.synchronize(batch.device)
            started = time.perf_counter()
            found = on_cpu(index.search(batch[start:end], k))
            seconds += time.perf_counter() - started
            hits.append(found)
        done += len(batch)
    widest = max(found.place.shape[1] for found in hits)
    return joined([_filled(found, widest) for found in hits]), seconds / done


def _one_by_one(batches: Iterable[Tensor]) -> Iterator[Tensor]:
    for batch in batches:
        yield from torch.split(finite("database", batch), 1)


def _runs(searched: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Begin and end of each run of queries that are compared with the same places."""
    bounds = [0, *(np.flatnonzero(np.diff(searched)) + 1).tolist(), len(searched)]
    return pairwise(bounds)


def _filled(hits: Hits, k: int) -> Hits:
    place, score, turn = (None if part is None else filled(part, k) for part in hits)
    assert place is not None
    assert score is not None
    return Hits(place, score, turn)


def filled(values: Tensor, k: int) -> Tensor:
    """Values (..., k) of the best places: where there are fewer, the last one is repeated.

    It is behind itself then, where it changes no rank of a first right place.

    >>> filled(torch.tensor([[7, 3]]), 4)
    tensor([[7, 3, 3, 3]])
    """
    lacking = max(0, k - values.shape[-1])
    return torch.cat([values, values[..., -1:].expand(*values.shape[:-1], lacking)], dim=-1)
