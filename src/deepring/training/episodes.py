"""N-way episodes: places as classes, a few scans of each as shots and queries (paper, Sec. IV)."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset, Sampler

from deepring.data.packed_rasters import Rasters
from deepring.errors import DeepringError
from deepring.training.training_scans import TrainingScans, check_apart, set_apart, within


@dataclass  # not frozen, since it is a config group too
class EpisodeSettings:
    """An episode; distances in metres. Defaults are the paper's."""

    ways: int = 24
    shots: int = 1
    queries: int = 6
    per_epoch: int = 60
    same: float = 10.0
    different: float = 20.0

    def __post_init__(self) -> None:
        for name in ("ways", "shots", "queries", "per_epoch"):
            least = 2 if name == "ways" else 1
            if getattr(self, name) < least:
                raise DeepringError(
                    f"episode.{name}: {getattr(self, name)}, expected at least {least}"
                )
        check_apart("episode", self.same, self.different)

    def training_set(self, pool: TrainingScans, seed: int) -> "EpisodeDataset":
        """Episodes of a pool. Raises DeepringError where it holds fewer places than ways."""
        places = Places(pool.positions, pool.owners, self)
        places.sample(np.random.default_rng([seed, 0]))  # fail here, not in a worker
        return EpisodeDataset(places, pool.rasters, seed)


class Episode(NamedTuple):
    """Images of one episode; way k's support and queries share row k."""

    support: torch.Tensor
    """(ways, shots, *raster.shape)."""
    query: torch.Tensor
    """(ways, queries, *raster.shape)."""


class Places:
    """Scans on the ground, from which classes are drawn.

    All scans of a class lie within ``same`` metres of each other, scans of different classes
    beyond ``different`` metres. Scans of different datasets are always different.

    Args:
        positions: (n, 2) float64 metres.
        dataset: (n,) which dataset each scan is from.
        settings: the episode.
    """

    def __init__(
        self, positions: NDArray[np.float64], dataset: NDArray[np.int64], settings: EpisodeSettings
    ) -> None:
        self.settings = settings
        self.size = settings.shots + settings.queries
        self.points = set_apart(positions, dataset)
        self.near = within(self.points, settings.same)
        self.around = within(self.points, settings.different)
        counts = np.array([len(near) for near in self.near], dtype=np.int64)
        self.anchors = np.flatnonzero(counts >= self.size)

    def sample(self, rng: np.random.Generator, tries: int = 20) -> NDArray[np.int64]:
        """Scan indices (ways, shots + queries) of one episode; the shots come first.

        Raises DeepringError where the scans hold fewer places than ways.
        """
        most = 0
        for _ in range(tries):
            classes = self._draw_classes(rng)
            if len(classes) == self.settings.ways:
                return np.stack(classes)
            most = max(most, len(classes))
        s = self.settings
        raise DeepringError(
            f"episode.ways: {s.ways} classes asked for, but {len(self.points)} scans of the "
            f"training region hold only {most} places of {self.size} scans within {s.same:g} m "
            f"of each other and beyond {s.different:g} m of the other places; lower episode.ways "
            "or episode.queries, enlarge data.regions.train, or lower data.spacing.train"
        )

    def _draw_classes(self, rng: np.random.Generator) -> list[NDArray[np.int64]]:
        """Up to ``ways`` classes, anchored at scans in random order."""
        classes: list[NDArray[np.int64]] = []
        taken = np.zeros(len(self.points), dtype=np.bool_)
        for anchor in rng.permutation(self.anchors):
            if taken[anchor]:
                continue
            members = self._draw_members(int(anchor), taken, rng)
            if members is None:
                continue
            classes.append(members)
            for member in members:
                taken[self.around[member]] = True
            if len(classes) == self.settings.ways:
                break
        return classes

    def _draw_members(
        self, anchor: int, taken: NDArray[np.bool_], rng: np.random.Generator
    ) -> NDArray[np.int64] | None:
        """Random scans around the anchor, each within ``same`` of all others."""
        free = self.near[anchor][~taken[self.near[anchor]]]
        candidates = rng.permutation(free[free != anchor])
        members = [anchor]
        for candidate in candidates:
            apart = np.linalg.norm(self.points[members] - self.points[candidate], axis=1)
            if (apart <= self.settings.same).all():
                members.append(int(candidate))
            if len(members) == self.size:
                return rng.permutation(np.array(members, dtype=np.int64))
        return None


class EpisodeDataset(Dataset[Episode]):
    """Episode number i, the same in every process and for any number of workers."""

    def __init__(self, places: Places, rasters: Rasters, seed: int) -> None:
        self.places, self.rasters, self.seed = places, rasters, seed

    def __len__(self) -> int:
        """Episodes in an epoch."""
        return self.places.settings.per_epoch

    def __getitem__(self, index: int) -> Episode:
        """Draw episode ``index``, of all epochs counted through."""
        rng = np.random.default_rng([self.seed, index])
        scans = self.places.sample(rng)
        shots = self.places.settings.shots
        return Episode(self.rasters[scans[:, :shots]], self.rasters[scans[:, shots:]])


class BatchOrder(Sampler[int]):
    """Numbers of an epoch's batches; each process of a distributed run takes its own."""

    def __init__(self, per_epoch: int, rank: int = 0, world_size: int = 1) -> None:
        self.per_epoch, self.rank, self.world_size = per_epoch, rank, world_size
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Called by Lightning at the start of each epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        return math.ceil(self.per_epoch / self.world_size)

    def __iter__(self) -> Iterator[int]:
        first = self.epoch * len(self) * self.world_size
        for k in range(len(self)):
            yield first + k * self.world_size + self.rank
