"""Exhaustive search by a method's own comparison."""

from typing import Any, Protocol

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring.checks import count
from deepring.search.block_store import BlockStore
from deepring.search.given import given_rows
from deepring.search.hits import Best, Hits

#: Places compared at once.
_CHUNK = 1024


class Scores(Protocol):
    """The result of `Comparer.compare`."""

    @property
    def score(self) -> Float[Tensor, "q d"]:
        """(q, d); higher is more similar."""
        ...

    @property
    def turn(self) -> Float[Tensor, "q d"] | None:
        """(q, d) radians; None if unknown."""
        ...


class Comparer(Protocol):
    """Anything that compares descriptors, e.g. a method."""

    def compare(
        self, queries: Float[Tensor, " q *descriptor"], database: Float[Tensor, " d *descriptor"]
    ) -> Scores:
        """Compare descriptors (q, ...) with descriptors (d, ...)."""
        ...


class CompareIndex:
    """Exhaustive search by a method's ``compare``, chunk by chunk."""

    def __init__(self, method: Comparer) -> None:
        self.method = method
        self.places = BlockStore()
        self._shape: tuple[int, ...] | None = None  # of a descriptor

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places. Raises DataError for descriptors of another shape than theirs."""
        descriptors = given_rows("descriptors", descriptors, self._shape)
        if len(descriptors):
            self.places.add({"descriptor": descriptors})
            self._shape = tuple(descriptors.shape[1:])

    def search(self, queries: Any, k: int = 1) -> Hits:
        """The ``k`` most similar places."""
        count("k", k)
        queries = given_rows("queries", queries, self._shape)
        best = Best(len(queries), k, queries.device)
        for start, (part,) in self.places.chunks(_CHUNK, "descriptor"):
            score = self.method.compare(queries, part).score
            best.update(score, torch.arange(start, start + len(part), device=score.device))
        return Hits(best.place, best.score, self._turns(queries, best.place))

    def _turns(
        self, queries: Float[Tensor, " q *descriptor"], places: Int64[Tensor, "q k"]
    ) -> Float[Tensor, "q k"] | None:
        """Turns of the hits only, since some methods align few entries per query."""
        turns = []
        for query, place in zip(queries, places, strict=True):
            if not len(place):
                continue
            turn = self.method.compare(query[None], self.places.take(place, "descriptor")[0]).turn
            if turn is None:
                return None
            turns.append(turn)
        return torch.cat(turns) if turns else None
