"""An index of scans as points with classes, compared as SSC compares them."""

from typing import Any

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring.checks import count
from deepring.core.correlation import shift_to_turn
from deepring.methods.ssc.ssc_keys import key_distances, label_keys
from deepring.methods.ssc.ssc_pairs import PairSettings, align_query
from deepring.search.block_store import BlockStore
from deepring.search.given import given_descriptors
from deepring.search.hits import Best, Hits

#: Places whose points are in memory at once, beside the store's.
_CHUNK = 1024

#: Keys that are compared at once.
_KEYS = 65_536


class SscIndex:
    """Points of places, all of them aligned with each query, or the ``candidates`` by their keys.

    Keys are computed once per place.
    """

    def __init__(self, settings: PairSettings, candidates: int | None = None) -> None:
        self.settings, self.candidates = settings, candidates
        self.places = BlockStore()
        self._shape: tuple[int, ...] | None = None  # of a descriptor

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places. Raises DataError for descriptors of another shape than theirs."""
        points = self._given("descriptors", descriptors)
        if len(points):
            self.places.add({"points": points, "key": label_keys(points, self.settings)})
            self._shape = tuple(points.shape[1:])

    def search(self, queries: Any, k: int = 1) -> Hits:
        """The ``k`` places of the largest share of alike cells, with the turn from place to query.

        With candidates these are the only ones.
        """
        count("k", k)
        queries = self._given("queries", queries)
        found = [self._search_one(query, k) for query in queries]
        best = Best(0, k) if not found else None
        place, score, roll = (
            (best.place, best.score, best.shift)
            if best is not None
            else (torch.cat(part) for part in zip(*found, strict=True))
        )
        return Hits(place, score, shift_to_turn(roll, self.settings.sectors))

    def _search_one(
        self, query: Float[Tensor, "point xyc"], k: int
    ) -> tuple[Int64[Tensor, "1 k"], Float[Tensor, "1 k"], Int64[Tensor, "1 k"]]:
        best = Best(1, k)
        if self.candidates is None or self.candidates >= len(self):
            for start, (points,) in self.places.chunks(_CHUNK, "points"):
                self._update(best, query, points, torch.arange(start, start + len(points)))
        else:
            numbers = self._nearest_keys(query[None], self.candidates).sort().values
            self._update(best, query, self.places.take(numbers, "points")[0], numbers)
        return best.place, best.score, best.shift

    def _update(
        self,
        best: Best,
        query: Float[Tensor, "point xyc"],
        points: Float[Tensor, "n point xyc"],
        numbers: Int64[Tensor, " n"],
    ) -> None:
        found = align_query(query, points, torch.arange(len(points)), self.settings)
        best.update(found.score[None], numbers, found.roll[None])

    def _nearest_keys(
        self, queries: Float[Tensor, "1 point xyc"], number: int
    ) -> Int64[Tensor, " _"]:
        best, keys = Best(1, number), label_keys(queries, self.settings)
        for start, (part,) in self.places.chunks(_KEYS, "key"):
            best.update(-key_distances(keys, part), torch.arange(start, start + len(part)))
        return best.place[0]

    def _given(self, name: str, values: Any) -> Float[Tensor, "n point xyc"]:
        return given_descriptors(name, values, self._shape, ("point", "xyc")).cpu().float()
