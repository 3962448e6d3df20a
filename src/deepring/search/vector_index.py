"""Search by Euclidean distance or cosine, for methods whose descriptors are vectors (FAISS)."""

from collections.abc import Callable
from typing import Any, Literal

import torch
import torch.nn.functional as F
from torch import Tensor

from deepring.errors import DeepringError
from deepring.search.block_store import BlockStore
from deepring.search.hits import Best, Hits

Metric = Literal["l2", "cosine"]

#: How many more neighbours FAISS is asked for than wanted. In batches it computes L2 by
#: products, whose cancellation confuses neighbours that are close; these are compared again.
_SPARE = 32


class VectorIndex:
    """Exhaustive search of vectors by FAISS's flat index, on the CPU.

    Scores are -‖Q - D‖, or the cosine.

    Args:
        metric: 'l2' or 'cosine'.
        vectors: makes vectors (n, d) of descriptors; by default these are flattened.
        align: turn (k,) of one query's descriptor to those of places (k, ...); descriptors are
            then kept. None: the turn is not known.
    """

    def __init__(
        self,
        metric: Metric,
        vectors: Callable[[Tensor], Tensor] | None = None,
        align: Callable[[Tensor, Tensor], Tensor] | None = None,
    ) -> None:
        if metric not in ("l2", "cosine"):
            raise DeepringError(f"metric: {metric!r}, expected 'l2' or 'cosine'")
        self.metric, self.align = metric, align
        self._make_vectors = vectors or (lambda descriptors: descriptors.flatten(1))
        self._flat: Any = None
        self._descriptors = BlockStore()

    def __len__(self) -> int:
        return 0 if self._flat is None else int(self._flat.ntotal)

    def add(self, descriptors: Tensor) -> None:
        """Add places by their descriptors (n, ...)."""
        import faiss

        vectors = self._vectors(descriptors)
        if self._flat is None:
            kind = faiss.IndexFlatL2 if self.metric == "l2" else faiss.IndexFlatIP
            self._flat = kind(vectors.shape[1])
        self._flat.add(self._checked(vectors))
        if self.align is not None:
            self._descriptors.add({"descriptor": descriptors.cpu()})

    def search(self, queries: Tensor, k: int = 1) -> Hits:
        """The ``k`` nearest places of queries (q, ...)."""
        if k < 1:
            raise DeepringError(f"k: {k}, expected at least 1")
        best = Best(len(queries), k)
        if self._flat is not None:
            vectors = self._vectors(queries)
            _, near = self._flat.search(self._checked(vectors), min(k + _SPARE, len(self)))
            near.sort(axis=1)
            found = torch.from_numpy(self._flat.reconstruct_batch(near.ravel()))
            best.see(self._score(vectors, found.view(*near.shape, -1)), torch.from_numpy(near))
        return Hits(best.place, best.score, self._turns(queries.cpu(), best.place))

    def _score(self, queries: Tensor, found: Tensor) -> Tensor:
        if self.metric == "cosine":
            return torch.einsum("qd,qkd->qk", queries, found)
        return -torch.linalg.vector_norm(queries[:, None] - found, dim=-1)

    def _turns(self, queries: Tensor, places: Tensor) -> Tensor | None:
        if self.align is None:
            return None
        turns = torch.empty(places.shape)
        for k, place in enumerate(places):
            if len(place):
                turns[k] = self.align(queries[k], self._descriptors.take(place, "descriptor")[0])
        return turns

    def _vectors(self, descriptors: Tensor) -> Tensor:
        vectors = self._make_vectors(descriptors).detach().float().cpu()
        return F.normalize(vectors, dim=1) if self.metric == "cosine" else vectors

    def _checked(self, vectors: Tensor) -> Any:
        if vectors.shape[1] != self._flat.d:
            raise DeepringError(
                f"descriptors: {vectors.shape[1]} numbers, but the places have {self._flat.d}; "
                "describe both by one method"
            )
        return vectors.contiguous().numpy()
