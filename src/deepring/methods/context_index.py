"""Scan Context's search: columns at unit norm and which are filled, two correlations at once."""

import torch
from torch import Tensor

from deepring.core.correlation import shift_to_turn
from deepring.errors import DeepringError
from deepring.methods.scan_context import mean_cosines, ring_keys, unit_columns
from deepring.search.block_store import BlockStore
from deepring.search.hits import Best, Hits

#: Floats of correlation curves that are held at once.
_CURVES = 2**20


class ContextIndex:
    """Places by their contexts (n, θ, r), compared over all column shifts.

    With ``candidates`` only those with the nearest ring keys are, as in the original.
    """

    def __init__(self, candidates: int | None = None) -> None:
        self.candidates = candidates
        self.places = BlockStore()

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Tensor) -> None:
        """Add places."""
        descriptors = descriptors.cpu()
        columns, filled = unit_columns(descriptors)
        self.places.add({"columns": columns, "filled": filled, "key": ring_keys(descriptors)})

    def search(self, queries: Tensor, k: int = 1) -> Hits:
        """The ``k`` places of the largest mean cosine, with the turn from place to query."""
        if k < 1:
            raise DeepringError(f"k: {k}, expected at least 1")
        best, queries = Best(len(queries), k), queries.cpu()
        columns, filled = unit_columns(queries)
        if self.candidates is None or self.candidates >= len(self):
            size = max(16, _CURVES // max(1, queries.shape[1] * len(queries)))
            for start, part in self.places.chunks(size, "columns", "filled"):
                score, shift = mean_cosines(columns, filled, *part).max(dim=-1)
                best.see(score, torch.arange(start, start + score.shape[1]), shift)
        else:
            places = self._nearest_keys(queries, self.candidates).sort(dim=1).values
            found = []
            for which, place in enumerate(places):
                one = slice(which, which + 1)
                part = self.places.take(place, "columns", "filled")
                found.append(mean_cosines(columns[one], filled[one], *part).max(dim=-1))
            best.see(torch.cat([f[0] for f in found]), places, torch.cat([f[1] for f in found]))
        return Hits(best.place, best.score, shift_to_turn(best.shift, queries.shape[-2]))

    def _nearest_keys(self, queries: Tensor, count: int) -> Tensor:
        """The places (q, count) whose ring keys are nearest (L2)."""
        best = Best(len(queries), count)
        keys = ring_keys(queries)
        for start, (part,) in self.places.chunks(65_536, "key"):
            # Without matrix products, whose cancellation confuses keys that are close.
            distance = torch.cdist(keys, part, compute_mode="donot_use_mm_for_euclid_dist")
            best.see(-distance, torch.arange(start, start + len(part)))
        return best.place
