"""A side of a retrieval set as it is looked up: descriptors, and where they were taken."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.data.dataset import distances_between
from deepring.methods.base import Method
from deepring.methods.describe import Images


class Placed(Protocol):
    """Whatever lies somewhere: a `ScanSet`, or descriptors."""

    @property
    def positions(self) -> NDArray[np.float64]:
        """World positions (n, 2), metres."""
        ...


@dataclass(frozen=True, eq=False)
class Described:
    """A side without scans and images."""

    descriptors: Images
    """(n, ...): a tensor, or `AsAsked`."""
    positions: NDArray[np.float64]
    """(n, 2) world positions, metres."""

    def __len__(self) -> int:
        return len(self.positions)


@dataclass(frozen=True, eq=False)
class AsAsked:
    """Descriptors (n, ...) of n images, made anew for whatever rows are asked for."""

    method: Method
    images: Images
    device: torch.device | None = None

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, rows: slice, /) -> Tensor:
        return self.method.describe(self.images[rows].to(self.device))


def distances_to(places: Placed, positions: NDArray[np.float64]) -> Tensor:
    """Metres (q, d) float32 from (q, 2) world positions to d places."""
    return distances_between(positions, places)  # type: ignore[arg-type]  # asks for positions


def shortest_distance(query: Placed, database: Placed, enough: float, batch: int = 64) -> float:
    """Metres from any query to any place, in float32; the search ends at ``enough`` or less.

    ``batch`` queries are compared at a time. Infinite where there are none.
    """
    shortest = torch.tensor(torch.inf)
    positions = query.positions
    for start in range(0, len(positions), batch):
        distances = distances_to(database, positions[start : start + batch])
        shortest = torch.minimum(shortest, distances.amin())
        if shortest <= enough:
            break
    return float(shortest)
