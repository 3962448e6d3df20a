"""The best places of a search as candidates: spread over the map, aligned with the query, ordered.

`by_pose` orders candidates by how far the query seems to be from each; it knows scans alone. What
the map's poses add is in `deepring.localization.location`.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import torch
from torch import Tensor

from deepring import checks
from deepring.localization.alignment import (
    Alignment,
    AlignmentSettings,
    align,
    half_whitened,
    occupied_cells,
)

Rerank = Literal["pose", "locate"]
"""By the distance estimated from scans; by the position that the map's poses give."""


@dataclass(frozen=True)
class RerankSettings:
    """How candidates are aligned and chosen from."""

    candidates: int = 25
    close: float = 0.65
    """Share of the best fit from which on a candidate counts as fitting, in `by_pose`."""
    apart: float = 15.0
    """Metres from which on two positions of the query contradict each other."""
    spread: float = 5.0
    """Metres between candidates, where the map's poses are known: those of a dense map would all be
    neighbours, and none of them could contradict the best."""
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)

    def __post_init__(self) -> None:
        checks.count("rerank.candidates", self.candidates)
        checks.positive("rerank.close", checks.share("rerank.close", self.close))
        checks.positive("rerank.apart", self.apart, "metres")
        checks.at_least("rerank.spread", self.spread, 0, "metres")


def align_candidates(
    image: Tensor, turn: Tensor | None, places: Tensor, settings: RerankSettings
) -> Alignment:
    """Align a query with its candidates.

    Args:
        image: (n, n) occupancy of the query.
        turn: (k,) radians, turns of the points from place to query that the search found; they
            and their opposites are tried. None tries the whole turn.
        places: (k, n, n) occupancy of the candidates.
        settings: of the alignment.
    """
    alignment = settings.alignment
    if turn is None or torch.isnan(turn).any():
        step = 3 * alignment.step  # each is tried a step less and more
        tried = torch.arange(0, 2 * math.pi, step).expand(len(places), -1)
    else:
        tried = torch.stack([turn, turn + math.pi], dim=1)
    cells = occupied_cells(image, alignment)
    return align(cells, half_whitened(places, alignment), tried, alignment)


def spread_out(positions: Tensor, settings: RerankSettings) -> Tensor:
    """Numbers of the first ``candidates`` of positions (k, 2), best first, that lie ``spread``
    metres or more from all better ones that are taken."""
    away = torch.cdist(positions, positions)
    taken: list[int] = []
    for k in range(len(positions)):
        if len(taken) == settings.candidates:
            break
        if not taken or bool((away[k, taken] >= settings.spread).all()):
            taken.append(k)
    return torch.tensor(taken, dtype=torch.int64)


def by_pose(alignment: Alignment, settings: RerankSettings) -> Tensor:
    """The candidates' numbers (k,), best first: those that fit, by how near the query seems to
    be; then the others by their fit."""
    fit = alignment.score
    fits = fit >= settings.close * fit.max()
    away = torch.linalg.vector_norm(alignment.position, dim=-1)
    return torch.where(fits, away, 1e6 * (2 - fit)).argsort(stable=True)
