"""Exhaustive search by Euclidean distance or cosine, for methods whose descriptors are vectors."""

from collections.abc import Callable
from typing import Any, Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Float32, Int64
from torch import Tensor

from deepring.checks import count, one_of
from deepring.search.block_store import BlockStore
from deepring.search.given import given_descriptors
from deepring.search.hits import Best, Hits

Metric = Literal["l2", "cosine"]

#: Candidates beyond ``k``. Products rank them imprecisely, owing to cancellation; candidates are
#: then compared by differences.
SPARE = 32

#: With fewer queries than this, products are computed with the places first.
_FEW = 8

#: Places compared at once: with few queries, with many, and by differences.
_CHUNK_OF_FEW, _CHUNK, _CHUNK_OF_DIFFERENCES = 65_536, 16_384, 4096


class VectorIndex:
    """Exhaustive search of float32 vectors on the CPU. Scores are -‖Q - D‖, or the cosine.

    Matrix products select candidates, and only these are compared by differences. The rounding of
    the products is bounded for each query: if a place outside the candidates could still be among
    the best, all places are compared by differences.

    Args:
        metric: 'l2' or 'cosine'.
        vectors: function from descriptors to vectors (n, d); by default flattens them.
        align: function of one query's descriptor and places (k, ...) that returns the turns (k,)
            from place to query; descriptors are then stored. With None, turns are unknown.

    Raises:
        ConfigError: an unknown metric, or k below 1.
        DataError: descriptors of another shape than the places', or that are not finite.
    """

    def __init__(
        self,
        metric: Metric,
        vectors: Callable[[Tensor], Tensor] | None = None,
        align: Callable[[Tensor, Tensor], Tensor] | None = None,
    ) -> None:
        self.metric, self.align = one_of("metric", metric, Metric), align
        self.places = BlockStore()
        self._make_vectors = vectors or (lambda descriptors: descriptors.flatten(1))
        self._shape: tuple[int, ...] | None = None  # of a descriptor
        self._largest = 0.0  # norm of any place's vector

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places by their descriptors (n, ...)."""
        descriptors = given_descriptors("descriptors", descriptors, self._shape)
        if not len(descriptors):
            return
        vectors = self._vectors(descriptors)
        norms = torch.linalg.vector_norm(vectors, dim=1)
        rows = {"vector": vectors, "offset": norms.square() / 2 if self._is_l2 else 0 * norms}
        if self.align is not None:
            rows["descriptor"] = descriptors.cpu()
        self.places.add(rows)
        self._largest = max(self._largest, float(norms.max()))
        self._shape = tuple(descriptors.shape[1:])

    def search(self, queries: Any, k: int = 1) -> Hits:
        """The ``k`` nearest places of queries (q, ...)."""
        count("k", k)
        queries = given_descriptors("queries", queries, self._shape)
        best = Best(len(queries), k)
        if len(self) and len(queries):
            vectors = self._vectors(queries)
            best = self._by_products(vectors, k)
        return Hits(best.place, best.score, self._turns(queries.cpu(), best.place))

    @property
    def _is_l2(self) -> bool:
        return self.metric == "l2"

    def _by_products(self, queries: Float32[Tensor, "q d"], k: int) -> Best:
        """The best among the candidates, or among all places where rounding could matter."""
        candidates = Best(len(queries), k + SPARE)
        size = _CHUNK_OF_FEW if len(queries) < _FEW else _CHUNK
        for start, (part, offset) in self.places.chunks(size, "vector", "offset"):
            numbers = torch.arange(start, start + len(part))
            candidates.update(_products(part, queries) - offset, numbers)
        place = candidates.place.sort(dim=1).values
        (vectors,) = self.places.take(place.flatten(), "vector")
        best = Best(len(queries), k)
        best.update(self._score(queries, vectors.view(*place.shape, -1)), place)
        if len(self) > k + SPARE:
            unsure = self._unsure(queries, best.score[:, -1], candidates.score[:, -1])
            if unsure.any():
                again = self._by_differences(queries[unsure], k)
                best.score[unsure], best.place[unsure] = again.score, again.place
        return best

    def _unsure(
        self,
        queries: Float32[Tensor, "q d"],
        worst: Float32[Tensor, " q"],
        bar: Float32[Tensor, " q"],
    ) -> Bool[Tensor, " q"]:
        """Whether (q,) a place outside the candidates could beat the ``worst`` (q,) hit.

        The rank is Q·D - ‖D‖²/2, at most ``bar`` (q,) outside the candidates. The error of a sum
        of d products is at most d units of rounding times the product of the norms.
        """
        norm = torch.linalg.vector_norm(queries, dim=1)
        rank = (norm.square() - worst.square()) / 2 if self._is_l2 else worst
        units = (queries.shape[1] + 8) * torch.finfo(torch.float32).eps
        slack = units * (norm + self._largest) ** 2
        return rank <= bar + slack

    def _by_differences(self, queries: Float32[Tensor, "q d"], k: int) -> Best:
        """The best of all places by differences, one query at a time."""
        best = Best(len(queries), k)
        for start, (part,) in self.places.chunks(_CHUNK_OF_DIFFERENCES, "vector"):
            score = torch.cat([self._score(query[None], part[None]) for query in queries])
            best.update(score, torch.arange(start, start + len(part)))
        return best

    def _score(
        self, queries: Float32[Tensor, "q d"], places: Float32[Tensor, "#q k d"]
    ) -> Float32[Tensor, "q k"]:
        """Scores (q, k) of queries (q, d) with places (q, k, d)."""
        if self._is_l2:
            return -torch.linalg.vector_norm(queries[:, None] - places, dim=-1)
        return torch.einsum("qd,qkd->qk", queries, places)

    def _turns(
        self, queries: Float[Tensor, " q *descriptor"], places: Int64[Tensor, "q k"]
    ) -> Float32[Tensor, "q k"] | None:
        if self.align is None:
            return None
        turns = torch.empty(places.shape)
        for k, place in enumerate(places):
            if len(place):
                turns[k] = self.align(queries[k], self.places.take(place, "descriptor")[0])
        return turns

    def _vectors(self, descriptors: Float[Tensor, " n *descriptor"]) -> Float32[Tensor, "n d"]:
        vectors = self._make_vectors(descriptors).detach().float().cpu()
        return F.normalize(vectors, dim=1) if not self._is_l2 else vectors


def _products(
    places: Float32[Tensor, "n d"], queries: Float32[Tensor, "q d"]
) -> Float32[Tensor, "q n"]:
    """Q·D (q, n) of queries (q, d) with places (n, d)."""
    if len(queries) >= _FEW:
        return queries @ places.T
    # A single query is repeated: BLAS multiplies a matrix by one vector at half the speed.
    several = queries if len(queries) > 1 else queries.repeat(2, 1)
    return (places @ several.T)[:, : len(queries)].T.contiguous()
