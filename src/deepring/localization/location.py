"""Where a query is in the world, from candidates whose poses are known, and when to trust it.

The candidate that fits best says where the query is in its frame, and its pose says where that is
in the world. This is localisation with the poses of the map, not the paper's protocol, and is to
be reported beside it and never in its place.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.localization.alignment import Alignment
from deepring.localization.candidates import RerankSettings

F = TypeVar("F", float, NDArray[np.float64])


@dataclass(frozen=True)
class AcceptanceThresholds:
    """When a location is trusted: both have to be reached.

    With the usual thresholds 99.8 % of the trusted locations are right where half of the scans are
    nowhere in the map, on simulated worlds of their own (`make weights`).
    """

    fit: float = 0.21
    """Of the alignment, at most 1."""
    ratio: float = 1.41
    """Of the fit to the best one that puts the scan elsewhere."""

    def accept(self, fit: F, ratio: F) -> bool | NDArray[np.bool_]:
        """Whether to trust it; of arrays (n,) an array (n,)."""
        return (fit >= self.fit) & (ratio >= self.ratio)


@dataclass(frozen=True)
class Location:
    """Where a scan was taken."""

    place: int
    """The map's place that it was found by."""
    name: str
    """That place's scan."""
    x: float
    """Metres, in the world of the map's poses."""
    y: float
    yaw: float
    """Heading in the world, radians in [-π, π)."""
    similarity: float
    """Of the descriptors, higher is more alike."""
    fit: float
    """Of the alignment, at most 1."""
    ratio: float
    """Of the fit to the best one that puts the scan elsewhere; infinite without any."""
    trusted: bool


class BestFit(NamedTuple):
    """The candidate that fits best, and where that puts the query."""

    candidate: int
    position: Tensor
    """(2,) metres in the world of the map's poses."""
    fit: float
    """Height of the correlation's peak, at most 1."""
    ratio: float
    """How many times as good as the best fit of a candidate that contradicts it."""


def best_fit(alignment: Alignment, poses: Tensor, settings: RerankSettings) -> BestFit:
    """Where the candidate that fits best puts the query.

    Args:
        alignment: of the query with each of k candidates.
        poses: (k, 3) of the candidates: x, y and yaw in the world, metres and radians.
        settings: of what contradicts.
    """
    positions = world_positions(alignment.position, poses)
    fit = alignment.score
    best = int(fit.argmax())
    away = torch.linalg.vector_norm(positions - positions[best], dim=-1) > settings.apart
    rival = float(fit[away].max()) if bool(away.any()) else 0.0
    ratio = float(fit[best]) / rival if rival > 0 else math.inf
    return BestFit(best, positions[best], float(fit[best]), ratio)


def world_positions(position: Tensor, poses: Tensor) -> Tensor:
    """Positions (k, 2) in the frames of planar poses (k, 3) as positions in the world (k, 2)."""
    cosine, sine = torch.cos(poses[:, 2]), torch.sin(poses[:, 2])
    x = poses[:, 0] + cosine * position[:, 0] - sine * position[:, 1]
    y = poses[:, 1] + sine * position[:, 0] + cosine * position[:, 1]
    return torch.stack([x, y], dim=-1)
