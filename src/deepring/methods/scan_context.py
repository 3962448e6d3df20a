"""Scan Context (Kim and Kim 2018; irapkaist/scancontext)."""

import torch
from torch import Tensor

from deepring.core.correlation import correlation_curves, shift_to_turn
from deepring.errors import DeepringError
from deepring.methods.base import Comparison, expect_raster
from deepring.rasters import ContextRaster


class ScanContext:
    """Largest heights over polar cells; the cosine of columns, at the best column shift.

    Descriptors are (b, sectors, rings): a row here is what the original calls a column. With
    ``candidates`` only the entries with the nearest ring keys are compared in full, as in the
    original (10); None compares all, as in the DeepRING paper.
    """

    def __init__(self, raster: ContextRaster | None = None, candidates: int | None = None) -> None:
        self.raster = ContextRaster() if raster is None else raster
        expect_raster("Scan Context", self.raster, ContextRaster)
        if candidates is not None and candidates < 1:
            raise DeepringError(f"method.candidates: {candidates}, expected null or at least 1")
        self.candidates = candidates

    def describe(self, rasters: Tensor) -> Tensor:
        """The heights as float32: (b, sectors, rings)."""
        return rasters.float()

    def compare(self, queries: Tensor, database: Tensor) -> Comparison:
        """1 - distance: the mean cosine over columns that are non-empty in both."""
        curves = mean_cosines(*unit_columns(queries), *unit_columns(database))
        score, shift = curves.max(dim=-1)
        if self.candidates is not None and self.candidates < len(database):
            keep = _nearest_ring_keys(queries, database, self.candidates)
            score = torch.where(keep, score, torch.full_like(score, -1.0))
        return Comparison(score, shift_to_turn(shift, queries.shape[-2]))


def mean_cosines(columns: Tensor, filled: Tensor, others: Tensor, others_filled: Tensor) -> Tensor:
    """Mean cosine over the columns filled in both, for all pairs and column shifts: (q, d, θ)."""
    cosines = correlation_curves(columns, others)
    shared = correlation_curves(filled, others_filled).round()
    return torch.where(shared > 0, cosines / shared.clamp_min(1.0), 0.0)


def ring_keys(context: Tensor) -> Tensor:
    """Mean over sectors of contexts (n, sectors, rings): (n, rings)."""
    return context.float().mean(dim=-2)


def unit_columns(context: Tensor) -> tuple[Tensor, Tensor]:
    """Columns at unit norm, and which are non-empty: (n, sectors, rings), (n, sectors, 1)."""
    norm = torch.linalg.vector_norm(context, dim=-1, keepdim=True)
    filled = norm > 0
    return torch.where(filled, context / norm.clamp_min(1e-12), 0.0), filled.float()


def _nearest_ring_keys(queries: Tensor, database: Tensor, count: int) -> Tensor:
    """Which entries (q, d) are among the ``count`` nearest in the mean over sectors (L2)."""
    # Without matrix products, whose cancellation confuses keys that are close.
    exact = "donot_use_mm_for_euclid_dist"
    distance = torch.cdist(ring_keys(queries), ring_keys(database), compute_mode=exact)
    nearest = distance.topk(count, largest=False).indices
    return torch.zeros_like(distance, dtype=torch.bool).scatter_(1, nearest, True)
