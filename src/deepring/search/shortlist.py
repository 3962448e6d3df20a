"""A shortlist by keys that are cheap to compare, for comparisons that are costly."""

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Bool, Float, Float32, Int64
from torch import Tensor

from deepring.checks import count
from deepring.search.block_store import BlockStore
from deepring.search.compare_index import Comparer
from deepring.search.given import given_descriptors
from deepring.search.hits import Best, Hits

Keys = Callable[[Tensor], Tensor]
"""From descriptors (n, ...) to keys (n, copies, k). A query's key is the first of its copies, a
place is as near as the nearest of its own."""

#: Keys that are compared at once.
_KEYS = 16_384


class ShortlistIndex:
    """The places with the nearest keys, compared by a method.

    Args:
        method: compares a query with its candidates.
        keys: of descriptors.
        candidates: places that are compared with each query.
    """

    def __init__(self, method: Comparer, keys: Keys, candidates: int) -> None:
        self.method, self.keys = method, keys
        self.candidates = count("candidates", candidates)
        self.places = BlockStore()
        self._shape: tuple[int, ...] | None = None  # of a descriptor

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places. Raises DataError for descriptors of another shape than theirs."""
        descriptors = given_descriptors("descriptors", descriptors, self._shape)
        if len(descriptors):
            self.places.add({"descriptor": descriptors, "key": self.keys(descriptors)})
            self._shape = tuple(descriptors.shape[1:])

    def search(self, queries: Any, k: int = 1) -> Hits:
        """The ``k`` most alike of the candidates, with the method's turns."""
        count("k", k)
        queries = given_descriptors("queries", queries, self._shape)
        best = Best(len(queries), k)
        turns: list[Tensor | None] = []
        if len(self) and len(queries):
            places = self.nearest(queries).sort(dim=1).values
            scores = []
            for query, place in zip(queries, places, strict=True):
                (entries,) = self.places.take(place, "descriptor")
                found = self.method.compare(query[None], entries)
                scores.append(found.score.float())
                turns.append(found.turn)
            # In place of shifts, the number of the candidate, whose turn is looked up.
            numbers = torch.arange(places.shape[1]).expand_as(places)
            best.update(torch.cat(scores).cpu(), places, numbers)
        known = [turn.cpu() for turn in turns if turn is not None]
        turn = torch.cat(known).gather(1, best.shift) if known else None
        return Hits(best.place, best.score, turn)

    def nearest(self, queries: Float[Tensor, " q *descriptor"]) -> Int64[Tensor, "q _"]:
        """The places (q, candidates) with the nearest keys."""
        keys = self.keys(queries)
        best = Best(len(queries), self.candidates)
        for start, (part,) in self.places.chunks(_KEYS, "key"):
            numbers = torch.arange(start, start + len(part))
            best.update(-key_distances(keys, part).cpu(), numbers)
        return best.place


def key_distances(
    queries: Float[Tensor, "q copy k"], places: Float[Tensor, "d copy k"]
) -> Float32[Tensor, "q d"]:
    """L2 of the first key of each query to the nearest key of each place: (q, d)."""
    # Without matrix products, whose cancellation confuses keys that are close.
    apart = torch.cdist(
        queries[:, 0].float(),
        places.flatten(0, 1).float(),
        compute_mode="donot_use_mm_for_euclid_dist",
    )
    return apart.view(len(queries), len(places), places.shape[1]).amin(dim=-1)


def shortlisted(distance: Float[Tensor, "q d"], candidates: int | None) -> Bool[Tensor, "q d"]:
    """Which places are among the ``candidates`` nearest of each query; all with None."""
    if candidates is None or candidates >= distance.shape[1]:
        return torch.ones_like(distance, dtype=torch.bool)
    nearest = distance.topk(candidates, largest=False).indices
    return torch.zeros_like(distance, dtype=torch.bool).scatter_(1, nearest, True)
