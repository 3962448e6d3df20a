"""The results of a search, and a running top k during a search."""

from typing import NamedTuple, Protocol

import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor


class Hits(NamedTuple):
    """The best places of each query, best first."""

    place: Int64[Tensor, "q k"]
    """(q, k) int64: numbers of the places in the order of adding."""
    score: Float32[Tensor, "q k"]
    """(q, k) float32; higher is more similar."""
    turn: Float32[Tensor, "q k"] | None
    """(q, k) float32 radians, the turn of the points from place to query; None if unknown."""


class Index(Protocol):
    """A searchable collection of places that can grow."""

    def __len__(self) -> int: ...

    def add(self, descriptors: Float[Tensor, " n *descriptor"]) -> None:
        """Add places by their descriptors (n, ...)."""
        ...

    def search(self, queries: Float[Tensor, " q *descriptor"], k: int = 1) -> Hits:
        """The ``k`` most similar places of queries (q, ...), or all if there are fewer."""
        ...


class Best:
    """A running top ``k`` of each query. Ties keep the earlier place."""

    def __init__(self, queries: int, k: int, device: torch.device | None = None) -> None:
        self.k = k
        self.score = torch.empty(queries, 0, device=device)
        self.place = torch.empty(queries, 0, dtype=torch.int64, device=device)
        self.shift = torch.empty(queries, 0, dtype=torch.int64, device=device)

    def update(
        self,
        score: Float[Tensor, "q n"],
        place: Int64[Tensor, "*#q n"],
        shift: Int64[Tensor, "q n"] | None = None,
    ) -> None:
        """Add scores (q, n) of further places (n,) or (q, n), with larger numbers than before."""
        if score.shape[1] > self.k:
            score, top = score.topk(self.k, dim=1)
            place = place[top] if place.ndim == 1 else place.gather(1, top)
            shift = None if shift is None else shift.gather(1, top)
        place = place.expand_as(score)
        shift = torch.zeros_like(place) if shift is None else shift
        score = torch.cat([self.score, score], dim=1)
        place = torch.cat([self.place, place], dim=1)
        shift = torch.cat([self.shift, shift], dim=1)
        # Sorted by place, then stably by score: the order does not depend on the chunks.
        order = place.argsort(dim=1)
        order = order.gather(1, score.gather(1, order).argsort(dim=1, descending=True, stable=True))
        order = order[:, : self.k]
        self.score = score.gather(1, order)
        self.place, self.shift = place.gather(1, order), shift.gather(1, order)
