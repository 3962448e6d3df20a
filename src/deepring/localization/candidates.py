"""The best candidates of a search aligned with the query, and what follows from it.

`by_pose` orders candidates by how far the query seems to be from each; it knows scans alone.
`by_location` takes the candidate that fits best, asks the map where that was, and names the map
place nearest to where the query then is. That is localisation with the poses of the map, not the
paper's protocol, and is to be reported beside it and never in its place.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import torch
from torch import Tensor

from deepring.errors import DeepringError
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
        lengths = self.apart > 0 and self.spread >= 0
        if self.candidates < 1 or not 0 < self.close <= 1 or not lengths:
            raise DeepringError(
                f"rerank.candidates: {self.candidates}, rerank.close: {self.close}, rerank.apart: "
                f"{self.apart}, rerank.spread: {self.spread}; expected at least 1, a share in "
                "(0, 1], metres above 0, and metres of at least 0"
            )


class Candidates(NamedTuple):
    """The k best places of one query, in the order of the search, and where it lies in each."""

    place: Tensor
    """(k,) int64 numbers in the map."""
    aligned: Alignment
    """Of the query in each place's frame."""


class Located(NamedTuple):
    """Where a query is."""

    candidate: int
    """Which of the candidates it was found by."""
    position: Tensor
    """(2,) metres in the world of the map's poses."""
    fit: float
    """Height of the correlation's peak, at most 1."""
    ratio: float
    """How many times as good as the best fit of a candidate that contradicts it."""


def expect_rerank(name: str, rerank: str) -> None:
    """Raise DeepringError where ``rerank`` is no `Rerank`."""
    if rerank not in get_args(Rerank):
        raise DeepringError(f"{name}: {rerank!r}, expected 'pose' or 'locate'")


def align_candidates(
    image: Tensor, place: Tensor, turn: Tensor | None, maps: Tensor, settings: RerankSettings
) -> Candidates:
    """Align a query with its candidates.

    Args:
        image: (n, n) occupancy of the query.
        place: (k,) the candidates.
        turn: (k,) radians, turns of the points from place to query that the search found; they
            and their opposites are tried. None tries the whole turn.
        maps: (k, n, n) occupancy of the candidates.
        settings: of the alignment.
    """
    alignment = settings.alignment
    if turn is None or torch.isnan(turn).any():
        step = 3 * alignment.step  # each is tried a step less and more
        whole = torch.arange(0, 2 * math.pi, step)
        tried = whole.expand(len(place), -1)
    else:
        tried = torch.stack([turn, turn + math.pi], dim=1)
    spectra = half_whitened(maps, alignment)
    cells = occupied_cells(image, alignment)
    return Candidates(place, align(cells, spectra, tried, alignment))


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


def by_pose(candidates: Candidates, settings: RerankSettings) -> Tensor:
    """The candidates' numbers (k,), best first: those that fit, by how near the query seems to
    be; then the others by their fit."""
    fit = candidates.aligned.score
    fits = fit >= settings.close * fit.max()
    away = torch.linalg.vector_norm(candidates.aligned.position, dim=-1)
    return torch.where(fits, away, 1e6 * (2 - fit)).argsort(stable=True)


def by_location(candidates: Candidates, poses: Tensor, settings: RerankSettings) -> Located:
    """Where the candidate that fits best puts the query.

    Args:
        candidates: aligned.
        poses: (k, 3) of the candidates: x, y and heading in the world, metres and radians.
        settings: of what contradicts.
    """
    positions = world_positions(candidates.aligned.position, poses)
    fit = candidates.aligned.score
    best = int(fit.argmax())
    away = torch.linalg.vector_norm(positions - positions[best], dim=-1) > settings.apart
    rival = float(fit[away].max()) if bool(away.any()) else 0.0
    ratio = float(fit[best]) / rival if rival > 0 else math.inf
    return Located(best, positions[best], float(fit[best]), ratio)


def world_positions(position: Tensor, poses: Tensor) -> Tensor:
    """Positions (k, 2) in the frames of planar poses (k, 3) as positions in the world (k, 2)."""
    cosine, sine = torch.cos(poses[:, 2]), torch.sin(poses[:, 2])
    x = poses[:, 0] + cosine * position[:, 0] - sine * position[:, 1]
    y = poses[:, 1] + sine * position[:, 0] + cosine * position[:, 1]
    return torch.stack([x, y], dim=-1)
