"""Search by the bits of LiDAR-Iris, 43 kB a place, in compiled loops on the CPU."""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from numpy.typing import NDArray
from torch import Tensor

from deepring.checks import count
from deepring.core.correlation import shift_to_turn
from deepring.methods.lidar_iris.iris_code import whole_numbers
from deepring.search.block_store import BlockStore
from deepring.search.given import given_descriptors
from deepring.search.hits import Best, Hits

#: Places compared at once; Ctrl-C is heard between them.
_CHUNK = 1024


class IrisIndex:
    """Packed codes (n, θ, numbers) of places, compared bit by bit at every shift."""

    def __init__(self) -> None:
        self.places = BlockStore()
        self._shape: tuple[int, ...] | None = None  # of a descriptor

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places. Raises DataError for descriptors of another shape than theirs."""
        descriptors = self._given("descriptors", descriptors)
        if len(descriptors):
            self.places.add({"bits": torch.from_numpy(_words(descriptors).view(np.int64))})
            self._shape = tuple(descriptors.shape[1:])

    def search(self, queries: Any, k: int = 1) -> Hits:
        """The ``k`` places that share most bits, with the turn from place to query."""
        count("k", k)
        queries = self._given("queries", queries)
        best = Best(len(queries), k)
        if len(self) and len(queries):
            score, shift = self.scores(queries)
            best.update(score, torch.arange(len(self)), shift)
        return Hits(best.place, best.score, shift_to_turn(best.shift, queries.shape[-2]))

    def scores(
        self, queries: Float[Tensor, "q theta number"]
    ) -> tuple[Float32[Tensor, "q n"], Int64[Tensor, "q n"]]:
        """The share of bits that agree with each place at the best shift, and that shift."""
        from deepring.methods.lidar_iris import _iris_kernels as _kernels

        distance = np.ones((len(queries), len(self)))
        shift = np.zeros(distance.shape, dtype=np.int64)
        words = _words(queries)
        for start, (part,) in self.places.chunks(_CHUNK, "bits"):
            entries = part.numpy().view(np.uint64)
            end = start + len(part)
            for q, query in enumerate(words):
                _kernels.nearest_shifts(query, entries, distance[q, start:end], shift[q, start:end])
        return torch.from_numpy(1 - distance).float(), torch.from_numpy(shift)

    def _given(self, name: str, values: Any) -> Float[Tensor, "n theta number"]:
        return given_descriptors(name, values, self._shape, ("θ", "numbers"))


def _words(descriptors: Float[Tensor, "n theta number"]) -> NDArray[np.uint64]:
    """The three parts of packed codes, (n, 3, θ, words) uint64."""
    parts = whole_numbers(descriptors.detach().cpu()).chunk(3, dim=-1)
    whole = np.ascontiguousarray(torch.stack(parts, dim=1).numpy().astype(np.uint16))
    words: NDArray[np.uint64] = whole.view(np.uint64)
    return words
