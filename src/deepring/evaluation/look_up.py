"""Looking queries up through a method's own index."""

import time
from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

from deepring.errors import DataError
from deepring.evaluation.metrics import one_percent
from deepring.methods.method import Method, index_of
from deepring.search.hits import Hits, Index
from deepring.search.search_settings import SearchSettings

#: Places per query: as many as Recall@5 needs.
BEST = 5


#: Every place is compared in float32, so that figures do not depend on a search's shortcuts.
EXACT = SearchSettings(precision="float32", code=None)


def best_of(places: int, least: int = BEST) -> int:
    """How many of a query's best places are kept: for Recall@5, Recall@1% and ``least``."""
    return max(BEST, least, one_percent(places))


def fill_index(method: Method, descriptors: Iterable[Tensor]) -> Index:
    """The method's index over the database's descriptors, which compares all places exactly.

    Args:
        method: the one that made the descriptors.
        descriptors: batches (b, ...) on any device.

    Raises:
        DataError: descriptors that are not finite.
    """
    index = index_of(method, EXACT)
    for batch in descriptors:
        index.add(finite("database", batch))
    return index


def look_up(index: Index, descriptors: Iterable[Tensor], k: int = BEST) -> tuple[Hits, float]:
    """The ``k`` best places of each query, on the CPU, and the seconds per query.

    Fewer than ``k`` where the index holds or compares fewer.

    Args:
        index: of the database.
        descriptors: batches (b, ...) of queries on any device; making them is not timed.
        k: places per query.

    Raises:
        DataError: descriptors or scores that are not finite.
    """
    hits: list[Hits] = []
    seconds = 0.0
    for batch in descriptors:
        if not hits:
            index.search(finite("queries", batch[:1]), k)  # a first search may compile
        if finite("queries", batch).is_cuda:  # else unfinished work on the GPU is timed
            torch.cuda.synchronize(batch.device)
        started = time.perf_counter()
        hits.append(on_cpu(index.search(batch, k)))
        seconds += time.perf_counter() - started
    whole = joined(hits)
    return whole, seconds / len(whole.place)


def joined(hits: Sequence[Hits]) -> Hits:
    """The hits of all queries, of as many places each. Raises DataError for scores that are NaN."""
    place, score, turn = zip(*hits, strict=True)
    turns = None if any(part is None for part in turn) else torch.cat(turn)
    whole = Hits(torch.cat(place), torch.cat(score), turns)
    if whole.score.isnan().any():
        raise DataError(f"scores: {int(whole.score.isnan().sum())} NaN, expected numbers")
    return whole


def on_cpu(hits: Hits) -> Hits:
    """The hits with their tensors on the CPU."""
    return Hits(*(None if part is None else part.cpu() for part in hits))  # type: ignore[arg-type]


def finite(side: str, descriptors: Tensor) -> Tensor:
    """The descriptors. Raises DataError unless all of their values are finite."""
    bad = int((~descriptors.isfinite()).sum())
    if bad:
        raise DataError(
            f"descriptors of the {side}: {bad} of {descriptors.numel()} values are not finite, "
            "expected numbers; look for empty scans, or for a training that diverged"
        )
    return descriptors
