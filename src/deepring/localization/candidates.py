"""The best places of a search as candidates: spread over the map, aligned with the query, ordered.

`by_pose` orders candidates by how far the query seems to be from each; it knows scans alone. What
the map's poses add is in `deepring.localization.location`.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from deepring import checks
from deepring.localization.alignment import (
    Alignment,
    align,
    align_coarsely,
    world_positions,
)
from deepring.localization.alignment.image_correlation import half_whitened, occupied_cells
from deepring.localization.alignment.settings import AlignmentSettings

#: Candidates that are aligned at the full resolution: the best at half of it, and the best of those
#: that contradict the very best. On four simulated drives (campuses and cities 110 and 111) they
#: name the same place as all 25 at the full resolution in each query.
_BEST, _RIVALS = 3, 3

#: The most of those that may fit, where poses are known: many do where nothing does.
_MOST = 8

#: Candidates that fit at half the resolution fit by this share of what is asked at the full one.
_ALLOWANCE = 0.85

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
    image: Tensor,
    turn: Tensor | None,
    places: Tensor,
    settings: RerankSettings,
    poses: Tensor | None = None,
) -> Alignment:
    """Align a query with its candidates, from coarse to fine.

    All are aligned at half the resolution, and those at the full one that may fit or contradict
    the one that does. The scores of the others are estimates, none larger than theirs.

    Args:
        image: (n, n) occupancy of the query.
        turn: (k,) radians, the turns of the points from place to query by the search; each and
            its opposite are tried. None tries turns all around.
        places: (k, n, n) occupancy of the candidates.
        settings: how candidates are aligned.
        poses: (k, 3) of the candidates: x, y and yaw in the world, metres and radians. They tell
            which candidates contradict each other.
    """
    alignment = settings.alignment
    if turn is None or torch.isnan(turn).any():
        step = 3 * alignment.step  # each is also tried one step smaller and larger
        trial_turns = torch.arange(0, 2 * math.pi, step).expand(len(places), -1)
    else:
        trial_turns = torch.stack([turn, turn + math.pi], dim=1)
    cells = occupied_cells(image, alignment)
    coarse = align_coarsely(cells, places, trial_turns, alignment)
    rows = _promising(coarse, poses, settings)
    spectra = half_whitened(places[rows], alignment)
    fine = align(cells, spectra, coarse.turn[rows, None], alignment)
    # Between two resolutions scores differ by a factor, the least for those that fit nowhere.
    factor = (fine.score / coarse.score[rows].clamp_min(1e-12)).min()
    coarse.score.mul_(factor).clamp_(max=fine.score.min())
    for whole, part in zip(coarse, fine, strict=True):
        whole[rows] = part
    return coarse


def _promising(coarse: Alignment, poses: Tensor | None, settings: RerankSettings) -> Tensor:
    """Indices of the candidates that are worth the full resolution: those that may fit, and the
    best of those that contradict the best."""
    score = coarse.score
    order = score.argsort(descending=True, stable=True)
    fits = score >= settings.close * score[order[0]]
    fits[order[:_BEST]] = True
    if poses is None:  # the nearest of all that fit is asked for
        fits |= score >= _ALLOWANCE * settings.close * score[order[0]]
    else:  # what decides is the best and its rivals
        fits[order[_MOST:]] = False
        positions = world_positions(coarse.position, poses)
        away = torch.linalg.vector_norm(positions - positions[order[0]], dim=-1) > settings.apart
        fits[order[away[order]][:_RIVALS]] = True
    return fits.nonzero()[:, 0]


def spread_out(positions: Tensor, settings: RerankSettings) -> Tensor:
    """Indices of up to ``candidates`` of the positions (k, 2), which come best first.

    A position is selected if it lies at least ``spread`` metres from all selected before it.
    """
    points = positions.cpu().numpy().astype(np.float64)
    selection: list[int] = []
    free = np.ones(len(points), dtype=np.bool_)
    while free.any() and len(selection) < settings.candidates:
        k = int(free.argmax())
        selection.append(k)
        away = np.hypot(*(points - points[k]).T)
        free &= away >= settings.spread
        free[k] = False
    return torch.tensor(selection, dtype=torch.int64)


def by_pose(alignment: Alignment, settings: RerankSettings) -> Tensor:
    """Indices (k,) of the candidates, best first.

    Those that fit come first, by their distance from the query; then the others, by their fit.
    """
    fit = alignment.score
    fits = fit >= settings.close * fit.max()
    away = torch.linalg.vector_norm(alignment.position, dim=-1)
    return torch.where(fits, away, 1e6 * (2 - fit)).argsort(stable=True)
