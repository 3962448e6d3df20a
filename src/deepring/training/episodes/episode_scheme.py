"""The episode scheme: places as classes, scans of each as shots and queries (paper, Sec. IV)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from deepring.checks import count, positive, share
from deepring.data.packed_rasters import Rasters
from deepring.errors import ConfigError
from deepring.methods.network import NetworkMethod
from deepring.training.episodes.episode_losses import EpisodeLoss
from deepring.training.episodes.graded_losses import GradedLoss
from deepring.training.episodes.places import Places
from deepring.training.scheme import Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, check_radii


class Episode(NamedTuple):
    """Scans of one episode: the shots of all ways, then the queries of all ways."""

    rasters: Tensor
    """(ways * (shots + queries), *raster.shape)."""
    ways: int
    shots: int
    distances: Tensor
    """(ways * queries, ways, shots) float32, metres from queries to shots, 1e6 between datasets."""

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
    ``negative_radius`` at different places. With the probability ``neighbours`` the next way lies
    within ``neighbour_radius`` of one of the last three, along the street or across; elsewhere, and
    where no such way is left, anywhere.

    With ``overlapping``, ``negative_radius`` is kept between the shots of different ways alone, and
    may be below ``positive_radius``: a query may be at the places of several ways, and needs a
    `GradedLoss`.
    """

    loss_type = EpisodeLoss

    ways: int = 24  # places of an episode
    shots: int = 1  # scans of each place that queries are compared with
    queries: int = 6  # of each place
    per_epoch: int = 60  # episodes
    positive_radius: float = 10.0
    negative_radius: float = 20.0
    neighbours: float = 0.0
    neighbour_radius: float = 35.0
    overlapping: bool = False

    def __post_init__(self) -> None:
        count("sampling.ways", self.ways, 2)
        for name in ("shots", "queries", "per_epoch"):
            count(f"sampling.{name}", getattr(self, name))
        if self.overlapping:
            positive("sampling.positive_radius", self.positive_radius, "metres")
            positive("sampling.negative_radius", self.negative_radius, "metres")
        else:
            check_radii(self.positive_radius, self.negative_radius)
        share("sampling.neighbours", self.neighbours)
        positive("sampling.neighbour_radius", self.neighbour_radius, "metres")
        if self.neighbours and not self.neighbour_radius > self.negative_radius:
            raise ConfigError(
                f"sampling.neighbour_radius: {self.neighbour_radius:g} m, expected more than "
                f"sampling.negative_radius, {self.negative_radius:g} m, beyond which other ways "
                "begin"
            )

    def training_set(self, scans: TrainingScans, seed: int) -> "EpisodeSet":
        """Episodes of the scans. Raises DataError for fewer places than ways."""
        places = Places(scans.points, self)
        places.sample(np.random.default_rng([seed, 0]))  # fails here rather than in a worker
        return EpisodeSet(places, scans.rasters, seed)

    def step(self, method: NetworkMethod, loss: EpisodeLoss, batch: Episode) -> Step:
        """Compare each query of the episode with all ways, by the method's similarity."""
        support, query = batch.split(method(batch.rasters))
        if isinstance(loss, GradedLoss):
            targets = loss.targets(batch.distances)
        else:
            own = torch.arange(batch.ways, device=query.device)
            targets = own.repeat_interleave(query.shape[1])
        return loss(query.flatten(0, 1), support, targets, method.score)

    def expect_loss(self, loss: nn.Module) -> None:
        """Raise ConfigError unless the loss is of episodes, and graded if ways overlap."""
        super().expect_loss(loss)
        if self.overlapping and not isinstance(loss, GradedLoss):
            raise ConfigError(
                f"sampling.overlapping: true, but {type(loss).__name__} knows one right way, "
                "expected a loss with targets by distance; choose loss=graded_cross_entropy or "
                "loss=smooth_ap, or sampling.overlapping=false"
            )


class EpisodeSet(TrainingSet[Episode]):
    """Episodes of randomly sampled places."""

    def __init__(self, places: Places, rasters: Rasters, seed: int) -> None:
        self.places, self.rasters, self.seed = places, rasters, seed

    def __len__(self) -> int:
        """Episodes per epoch."""
        return self.places.scheme.per_epoch

    def __getitem__(self, index: int) -> Episode:
        """Episode ``index``."""
        scans = self.places.sample(np.random.default_rng([self.seed, index]))
        ways, shots = self.places.scheme.ways, self.places.scheme.shots
        support, queries = scans[:, :shots], scans[:, shots:].ravel()
        rasters = self.rasters[np.concatenate([support.ravel(), queries])]
        points = self.places.points
        distances = np.linalg.norm(points[queries][:, None, None] - points[support], axis=-1)
        return Episode(rasters, ways, shots, torch.from_numpy(distances).float())
