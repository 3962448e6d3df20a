"""Scan Context (Kim and Kim 2018; irapkaist/scancontext)."""

from typing import Any

import torch
from jaxtyping import Float, Int64, Shaped
from torch import Tensor

from deepring.checks import count, of_type
from deepring.core.correlation import correlation_curves, shift_to_turn
from deepring.methods.method import Comparison, FixedMethod
from deepring.rasters import ContextRaster
from deepring.search.block_store import BlockStore
from deepring.search.given import given_descriptors
from deepring.search.hits import Best, Hits
from deepring.search.search_settings import SearchSettings

#: Floats of correlation curves in memory at once.
_CURVES = 2**20

#: Ring keys that are compared at once.
_KEYS = 65_536


class ScanContext(FixedMethod):
    """Largest heights over polar cells; the cosine of columns, at the best column shift.

    Descriptors are (b, sectors, rings): a row here is what the original calls a column. With
    ``candidates`` only the entries with the nearest ring keys are compared in full, as in the
    original (10); None compares all, as in the DeepRING paper.
    """

    def __init__(self, raster: ContextRaster | None = None, candidates: int | None = None) -> None:
        self.raster = of_type("Scan Context: raster", raster or ContextRaster(), ContextRaster)
        if candidates is not None:
            count("Scan Context: candidates", candidates)
        self.candidates = candidates

    def describe(self, rasters: Shaped[Tensor, "batch theta r"]) -> Float[Tensor, "batch theta r"]:
        """The heights as float32: (b, sectors, rings)."""
        return rasters.float()

    def compare(
        self, queries: Float[Tensor, "q theta r"], database: Float[Tensor, "d theta r"]
    ) -> Comparison:
        """The mean cosine over columns that are non-empty in both; -1 for no candidates."""
        score, shift = best_cosines(unit_columns(queries), unit_columns(database))
        if self.candidates is not None and self.candidates < len(database):
            distance = key_distances(queries, ring_keys(database))
            nearest = distance.topk(self.candidates, largest=False).indices
            is_candidate = torch.zeros_like(distance, dtype=torch.bool).scatter_(1, nearest, True)
            score = torch.where(is_candidate, score, -1.0)
        return Comparison(score, shift_to_turn(shift, queries.shape[-2]))

    @property
    def descriptor_shape(self) -> tuple[int, ...]:
        """(θ, r) of one descriptor."""
        return self.raster.shape

    def index(self, settings: SearchSettings | None = None) -> "ContextIndex":  # noqa: ARG002
        """Search by `compare`; takes no settings."""
        return ContextIndex(self.candidates)


class ContextIndex:
    """Contexts (n, θ, r) of places, compared as `ScanContext` compares them.

    Columns at unit norm, which are filled, and ring keys are computed once per place.
    """

    def __init__(self, candidates: int | None = None) -> None:
        self.candidates = candidates
        self.places = BlockStore()
        self._shape: tuple[int, ...] | None = None  # of a descriptor

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places. Raises DataError for descriptors of another shape than theirs."""
        descriptors = self._given("descriptors", descriptors)
        if not len(descriptors):
            return
        columns, filled = unit_columns(descriptors)
        self.places.add({"columns": columns, "filled": filled, "key": ring_keys(descriptors)})
        self._shape = tuple(descriptors.shape[1:])

    def search(self, queries: Any, k: int = 1) -> Hits:
        """The ``k`` places of the largest mean cosine, with the turn from place to query."""
        count("k", k)
        queries = self._given("queries", queries)
        best = Best(len(queries), k)
        columns, filled = unit_columns(queries)
        if self.candidates is None or self.candidates >= len(self):
            size = max(16, _CURVES // max(1, queries.shape[1] * len(queries)))
            for start, (part, part_filled) in self.places.chunks(size, "columns", "filled"):
                score, shift = best_cosines((columns, filled), (part, part_filled))
                best.update(score, torch.arange(start, start + len(part)), shift)
        elif len(queries):
            places = self._nearest_keys(queries, self.candidates).sort(dim=1).values
            scores, shifts = [], []
            for query, place in enumerate(places):
                one = slice(query, query + 1)
                part, part_filled = self.places.take(place, "columns", "filled")
                score, shift = best_cosines((columns[one], filled[one]), (part, part_filled))
                scores.append(score)
                shifts.append(shift)
            best.update(torch.cat(scores), places, torch.cat(shifts))
        return Hits(best.place, best.score, shift_to_turn(best.shift, queries.shape[-2]))

    def _given(self, name: str, values: Any) -> Float[Tensor, "n theta r"]:
        return given_descriptors(name, values, self._shape, ("θ", "r"))

    def _nearest_keys(
        self, queries: Float[Tensor, "q theta r"], number: int
    ) -> Int64[Tensor, "q _"]:
        """The places (q, number) whose ring keys are nearest."""
        best = Best(len(queries), number)
        for start, (keys,) in self.places.chunks(_KEYS, "key"):
            best.update(-key_distances(queries, keys), torch.arange(start, start + len(keys)))
        return best.place


Columns = tuple[Float[Tensor, "_ _ _"], Float[Tensor, "_ _ 1"]]
"""Columns at unit norm (n, sectors, rings), and 1.0 where they are non-empty (n, sectors, 1)."""


def unit_columns(context: Float[Tensor, "n theta r"]) -> Columns:
    """The columns of contexts (n, sectors, rings)."""
    norm = torch.linalg.vector_norm(context, dim=-1, keepdim=True)
    filled = norm > 0
    return torch.where(filled, context / norm.clamp_min(1e-12), 0.0), filled.float()


def best_cosines(
    queries: Columns, places: Columns
) -> tuple[Float[Tensor, "q n"], Int64[Tensor, "q n"]]:
    """The mean cosine over the columns filled in both, at the best column shift, and that shift.

    Both are (q, n), of all pairs.
    """
    cosines = correlation_curves(queries[0], places[0])
    shared = correlation_curves(queries[1], places[1]).round()
    best = torch.where(shared > 0, cosines / shared.clamp_min(1.0), 0.0).max(dim=-1)
    return best.values, best.indices


def ring_keys(context: Float[Tensor, "n theta r"]) -> Float[Tensor, "n r"]:
    """Mean over sectors of contexts (n, sectors, rings): (n, rings)."""
    return context.float().mean(dim=-2)


def key_distances(
    queries: Float[Tensor, "q theta r"], keys: Float[Tensor, "n r"]
) -> Float[Tensor, "q n"]:
    """L2 (q, n) of the ring keys of contexts (q, sectors, rings) to keys (n, rings)."""
    # Without matrix products, whose cancellation confuses keys that are close.
    return torch.cdist(ring_keys(queries), keys, compute_mode="donot_use_mm_for_euclid_dist")
