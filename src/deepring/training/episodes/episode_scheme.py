"""The episode scheme: places as classes, scans of each as shots and queries (paper, Sec. IV)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.checks import count
from deepring.data.packed_rasters import Rasters
from deepring.errors import DataError
from deepring.methods.network import NetworkMethod
from deepring.training.episodes.episode_losses import EpisodeLoss
from deepring.training.scheme import Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, check_radii, within


class Episode(NamedTuple):
    """Scans of one episode: the shots of all ways, then the queries of all ways."""

    rasters: Tensor
    """(ways * (shots + queries), *raster.shape)."""
    ways: int
    shots: int

    def split(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Views (ways, shots, ...) and (ways, queries, ...) of rows in the order of ``rasters``."""
        support, shape = self.ways * self.shots, rows.shape[1:]
        return (
            rows[:support].view(self.ways, self.shots, *shape),
            rows[support:].view(self.ways, -1, *shape),
        )


@dataclass(frozen=True)
class EpisodeScheme(TrainingScheme):
    """Episodes; distances in metres. Defaults are the paper's.

    Scans within ``positive_radius`` of each other are at the same place, those beyond
    ``negative_radius`` at different places.
    """

    loss_type = EpisodeLoss

    ways: int = 24
    shots: int = 1
    queries: int = 6
    per_epoch: int = 60
    positive_radius: float = 10.0
    negative_radius: float = 20.0

    def __post_init__(self) -> None:
        count("sampling.ways", self.ways, 2)
        for name in ("shots", "queries", "per_epoch"):
            count(f"sampling.{name}", getattr(self, name))
        check_radii(self.positive_radius, self.negative_radius)

    def training_set(self, scans: TrainingScans, seed: int) -> "EpisodeSet":
        """Episodes of the scans. Raises DataError for fewer places than ways."""
        places = Places(scans.points, self)
        places.sample(np.random.default_rng([seed, 0]))  # fails here rather than in a worker
        return EpisodeSet(places, scans.rasters, seed)

    def step(self, method: NetworkMethod, loss: EpisodeLoss, batch: Episode) -> Step:
        """Compare each query of the episode with all ways, by the method's similarity."""
        support, query = batch.split(method(batch.rasters))
        targets = torch.arange(batch.ways, device=query.device).repeat_interleave(query.shape[1])
        return loss(query.flatten(0, 1), support, targets, method.score)


class EpisodeSet(TrainingSet[Episode]):
    """Episodes of randomly sampled places."""

    def __init__(self, places: "Places", rasters: Rasters, seed: int) -> None:
        self.places, self.rasters, self.seed = places, rasters, seed

    def __len__(self) -> int:
        """Episodes per epoch."""
        return self.places.scheme.per_epoch

    def __getitem__(self, index: int) -> Episode:
        """Episode ``index``."""
        scans = self.places.sample(np.random.default_rng([self.seed, index]))
        ways, shots = self.places.scheme.ways, self.places.scheme.shots
        order = np.concatenate([scans[:, :shots].ravel(), scans[:, shots:].ravel()])
        return Episode(self.rasters[order], ways, shots)


class Places:
    """Positions of scans, from which classes are sampled.

    All scans of a class are within ``positive_radius`` of each other, scans of different classes
    beyond ``negative_radius``.

    Args:
        points: (n, 3) float64 metres, as `TrainingScans.points`.
        scheme: ways, shots, queries and radii of the episodes.
    """

    def __init__(self, points: NDArray[np.float64], scheme: EpisodeScheme) -> None:
        self.points, self.scheme = points, scheme
        self.size = scheme.shots + scheme.queries
        self.near = within(points, scheme.positive_radius)
        self.around = within(points, scheme.negative_radius)
        counts = np.array([len(near) for near in self.near], dtype=np.int64)
        self.anchors = np.flatnonzero(counts >= self.size)

    def sample(self, rng: np.random.Generator, tries: int = 20) -> NDArray[np.int64]:
        """Scan indices (ways, shots + queries) of one episode; the shots come first.

        Raises DataError for fewer places than ways.
        """
        most = 0
        for _ in range(tries):
            classes = self._sample_classes(rng)
            if len(classes) == self.scheme.ways:
                return np.stack(classes)
            most = max(most, len(classes))
        s = self.scheme
        raise DataError(
            f"sampling.ways: {s.ways}, but the {len(self.points)} scans of the training region "
            f"contain only {most} places of {self.size} scans within "
            f"{s.positive_radius:g} m of each other and beyond {s.negative_radius:g} m of the "
            "other places; lower sampling.ways or sampling.queries, enlarge data.regions.train, "
            "or lower data.spacing.train"
        )

    def _sample_classes(self, rng: np.random.Generator) -> list[NDArray[np.int64]]:
        """Up to ``ways`` classes, anchored at scans in random order."""
        classes: list[NDArray[np.int64]] = []
        free = np.ones(len(self.points), dtype=np.bool_)
        for anchor in rng.permutation(self.anchors):
            if not free[anchor]:
                continue
            members = self._sample_members(int(anchor), free, rng)
            if members is None:
                continue
            classes.append(members)
            for member in members:
                free[self.around[member]] = False
            if len(classes) == self.scheme.ways:
                break
        return classes

    def _sample_members(
        self, anchor: int, free: NDArray[np.bool_], rng: np.random.Generator
    ) -> NDArray[np.int64] | None:
        """Random scans around the anchor, each within ``positive_radius`` of all others."""
        near = self.near[anchor][free[self.near[anchor]]]
        candidates = rng.permutation(near[near != anchor])
        members = [anchor]
        for candidate in candidates:
            distances = np.linalg.norm(self.points[members] - self.points[candidate], axis=1)
            if (distances <= self.scheme.positive_radius).all():
                members.append(int(candidate))
            if len(members) == self.size:
                return rng.permutation(np.array(members, dtype=np.int64))
        return None
