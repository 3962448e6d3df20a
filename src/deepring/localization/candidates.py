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

#: Pixels of the transforms of all candidates of a query.
_PIXELS = 2**25

Rerank = Literal["pose", "locate"]
"""Order by the distance estimated from the scans, or by the position from the map's poses."""


@dataclass(frozen=True)
class RerankSettings:
    """How many candidates are aligned, and how they are ordered."""

    candidates: int = 25
    close: float = 0.65
    """A candidate fits if its fit is at least this share of the best one; see `by_pose`."""
    apart: float = 15.0
    """Two positions of the query contradict each other if they lie further apart, metres."""
    spread: float = 5.0
    """Smallest distance between candidates, metres, where the map's poses are known. Otherwise the
    candidates of a dense map would all be neighbours, and none could contradict the best."""
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)

    def __post_init__(self) -> None:
        most = _PIXELS // self.alignment.padded**2
        checks.count("rerank.candidates", self.candidates, most=most)
        checks.positive("rerank.close", checks.share("rerank.close", self.close))
        checks.positive("rerank.apart", self.apart, "metres")
        checks.at_least("rerank.spread", self.spread, 0, "metres")


def align_candidates(
    image: Tensor, turn: Tensor | None, places: Tensor, settings: RerankSettings
) -> Alignment:
    """Align a query with its candidates.

    Args:
        image: (n, n) occupancy of the query.
        turn: (k,) radians, the turns of the points from place to query by the search; each and
            its opposite are tried. None tries turns all around.
        places: (k, n, n) occupancy of the candidates.
        settings: how candidates are aligned.
    """
    alignment = settings.alignment
    if turn is None or torch.isnan(turn).any():
        step = 3 * alignment.step  # each is also tried one step smaller and larger
        trial_turns = torch.arange(0, 2 * math.pi, step).expand(len(places), -1)
    else:
        trial_turns = torch.stack([turn, turn + math.pi], dim=1)
    cells = occupied_cells(image, alignment)
    return align(cells, half_whitened(places, alignment), trial_turns, alignment)


def spread_out(positions: Tensor, settings: RerankSettings) -> Tensor:
    """Indices of up to ``candidates`` of the positions (k, 2), which come best first.

    A position is selected if it lies at least ``spread`` metres from all selected before it.
    """
    away = torch.cdist(positions, positions)
    selection: list[int] = []
    for k in range(len(positions)):
        if len(selection) == settings.candidates:
            break
        if not selection or bool((away[k, selection] >= settings.spread).all()):
            selection.append(k)
    return torch.tensor(selection, dtype=torch.int64)


def by_pose(alignment: Alignment, settings: RerankSettings) -> Tensor:
    """Indices (k,) of the candidates, best first.

    Those that fit come first, by their distance from the query; then the others, by their fit.
    """
    fit = alignment.score
    fits = fit >= settings.close * fit.max()
    away = torch.linalg.vector_norm(alignment.position, dim=-1)
    return torch.where(fits, away, 1e6 * (2 - fit)).argsort(stable=True)
