"""All scans that training draws from, of all datasets, with their positions and headings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from deepring.data.packed_rasters import Rasters
from deepring.data.scan_set import ScanSet
from deepring.errors import DeepringError

Neighbours = list[NDArray[np.int64]]
"""For each scan the sorted numbers of some others."""


def set_apart(positions: NDArray[np.float64], owners: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 3) metres: a third axis sets the datasets a thousand kilometres apart."""
    return np.column_stack([positions, owners * 1e6])


def within(points: NDArray[np.float64], radius: float) -> Neighbours:
    """For each of (n, 3) points those within ``radius`` metres, itself among them."""
    found = KDTree(points).query_ball_point(points, radius, return_sorted=True)
    return [np.array(indices, dtype=np.int64) for indices in found]


@dataclass(frozen=True, eq=False)
class TrainingScans:
    """n scans of the training regions."""

    positions: NDArray[np.float64]
    """(n, 2) metres, around each dataset's own origin, so that UTM keeps its precision."""
    owners: NDArray[np.int64]
    """(n,) which dataset each scan is from."""
    headings: NDArray[np.float64]
    """(n,) radians, counter-clockwise in the world."""
    rasters: Rasters

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3), see `set_apart`."""
        return set_apart(self.positions, self.owners)


class Part(NamedTuple):
    """Training scans of one session."""

    owner: int
    """Number of its dataset."""
    origin: NDArray[np.float64]
    """(2,) metres, of the dataset."""
    scans: ScanSet
    rasters: Rasters


def join(parts: Sequence[Part]) -> TrainingScans:
    """One pool of the sessions of all datasets."""
    data = np.concatenate([part.rasters.data for part in parts])
    return TrainingScans(
        np.concatenate([part.scans.positions - part.origin for part in parts]),
        np.concatenate([np.full(len(p.scans), p.owner, dtype=np.int64) for p in parts]),
        np.concatenate([part.scans.headings for part in parts]),
        Rasters(data, parts[0].rasters.raster),
    )


def check_apart(group: str, same: float, different: float) -> None:
    """Raise DeepringError unless scans of one place are nearer than those of different places."""
    if not 0 < same <= different:
        raise DeepringError(
            f"{group}.same: {same} m, {group}.different: {different} m; "
            "expected 0 < same <= different"
        )


class TrainingSet(Protocol):
    """Batches: item i is batch number i of all epochs counted through, the same in every process
    and for any number of workers."""

    def __len__(self) -> int:
        """Batches in an epoch."""
        ...

    def __getitem__(self, index: int, /) -> Any:
        """Draw a batch."""
        ...


class BatchSampling(Protocol):
    """How a method's training batches are drawn: settings that make a set of a pool."""

    def training_set(self, pool: TrainingScans, seed: int) -> TrainingSet:
        """Raises DeepringError where the pool holds too little."""
        ...
