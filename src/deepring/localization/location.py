"""Position of a query in the world, from candidates whose poses are known, and when to trust it.

The alignment with the candidate that fits best gives the query's position in that candidate's
frame, and the candidate's pose gives the position in the world. This is localisation with the map's
poses, not the paper's protocol: report it beside the protocol's results, never in their place.
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
    """Thresholds for trusting a location, which has to reach both.

    With the defaults, 99.8 % of the trusted locations are right on simulated worlds where half of
    the scans are nowhere in the map (`make weights`).
    """

    fit: float = 0.21
    """Fit of the alignment, at most 1."""
    ratio: float = 1.41
    """Ratio of the fit to the best fit that puts the scan elsewhere."""

    def accept(self, fit: F, ratio: F) -> bool | NDArray[np.bool_]:
        """Whether to trust a location; for arrays (n,), an array (n,)."""
        return (fit >= self.fit) & (ratio >= self.ratio)


@dataclass(frozen=True)
class Location:
    """Position and heading of a scan in the world."""

    place: int
    """Index of the map place that the scan was aligned with."""
    name: str
    """Name of that place's scan."""
    x: float
    """Metres, in the world of the map's poses."""
    y: float
    yaw: float
    """Heading in the world, radians in [-π, π)."""
    similarity: float
    """Similarity of the descriptors; higher is more alike."""
    fit: float
    """Fit of the alignment, at most 1."""
    ratio: float
    """Ratio of the fit to the best fit that puts the scan elsewhere; infinite without one."""
    trusted: bool


class BestFit(NamedTuple):
    """The candidate that fits best, and the position of the query by it."""

    candidate: int
    position: Tensor
    """(2,) metres in the world of the map's poses."""
    fit: float
    """Height of the correlation's peak, at most 1."""
    ratio: float
    """Ratio of the fit to the best fit of a candidate that contradicts it."""


def best_fit(alignment: Alignment, poses: Tensor, settings: RerankSettings) -> BestFit:
    """The position of the query by the candidate that fits best.

    Args:
        alignment: of the query with each of k candidates.
        poses: (k, 3) of the candidates: x, y and yaw in the world, metres and radians.
        settings: which positions contradict each other.
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
