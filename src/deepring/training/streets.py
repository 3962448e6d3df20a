"""The street scheme: a batch is a small map along streets and queries of another drive.

What is trained is what retrieval asks for: the right place among all its neighbours. Unlike the
ways of an episode, places are as close as those of a map, and queries lie anywhere between them.
"""

import logging
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.checks import count, interval, positive
from deepring.data.spacing import path_lengths
from deepring.errors import DataError
from deepring.methods.network import NetworkMethod
from deepring.training.episodes.graded_losses import GradedLoss
from deepring.training.scheme import Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, within

log = logging.getLogger(__name__)

Scans = NDArray[np.int64]
"""Numbers of training scans."""


class StreetBatch(NamedTuple):
    """The places of a small map, then queries."""

    rasters: Tensor
    """(places + queries, *raster.shape)."""
    places: int
    distances: Tensor
    """(queries, places) float32, metres; at least 1e6 between datasets."""


@dataclass(frozen=True)
class StreetScheme(TrainingScheme):
    """Batches of whole streets; distances in metres.

    A batch has ``stretches``, each of ``places`` scans in the order of a drive from a random scan
    on, and up to ``queries`` scans within ``positive_radius`` of one of these. The places of a
    batch are farther from each other than the ``spacing`` that is drawn from this interval for each
    stretch, and those of one dataset are of one session. The queries of a place are of another
    session if one passes there, else of another pass, more than ``pass_apart`` of path away, and
    else of the same pass.
    """

    loss_type = GradedLoss

    stretches: int = 2
    places: int = 16
    queries: int = 60
    spacing: tuple[float, float] = (10.0, 20.0)
    per_epoch: int = 60  # batches
    positive_radius: float = 10.0
    pass_apart: float = 100.0

    def __post_init__(self) -> None:
        for name in ("stretches", "queries", "per_epoch"):
            count(f"sampling.{name}", getattr(self, name))
        count("sampling.places", self.places, 2)
        interval("sampling.spacing", self.spacing, "metres")
        for name, value in (
            ("spacing[0]", self.spacing[0]),
            ("positive_radius", self.positive_radius),
            ("pass_apart", self.pass_apart),
        ):
            positive(f"sampling.{name}", value, "metres")

    def training_set(self, scans: TrainingScans, seed: int) -> "StreetSet":
        """Batches of the scans. Raises DataError for too few of them."""
        streets = StreetSet(scans, self, seed)
        streets.sample(np.random.default_rng([seed, 0]))  # fails here rather than in a worker
        streets.tell_drives()
        return streets

    def step(self, method: NetworkMethod, loss: GradedLoss, batch: StreetBatch) -> Step:
        """Look all queries up among all places, by the method's similarity."""
        descriptors = method(batch.rasters)
        places, queries = descriptors[: batch.places], descriptors[batch.places :]
        targets = loss.targets(batch.distances[:, :, None])
        return loss(queries, places[:, None], targets, method.score)


class StreetSet(TrainingSet[StreetBatch]):
    """Batches of randomly chosen streets, see `StreetScheme`."""

    def __init__(self, scans: TrainingScans, scheme: StreetScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.points = scans.points
        self.near = within(self.points, scheme.positive_radius)
        self.path = np.zeros(len(scans))
        for session in np.unique(scans.session):
            of_session = scans.session == session
            self.path[of_session] = path_lengths(scans.positions[of_session])

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch

    def __getitem__(self, index: int) -> StreetBatch:
        """Batch ``index``."""
        places, queries = self.sample(np.random.default_rng([self.seed, index]))
        distances = np.linalg.norm(self.points[queries][:, None] - self.points[places], axis=-1)
        rasters = self.scans.rasters[np.concatenate([places, queries])]
        return StreetBatch(rasters, len(places), torch.from_numpy(distances).float())

    def sample(self, rng: np.random.Generator, tries: int = 20) -> tuple[Scans, Scans]:
        """The places (stretches * places,) and queries of a batch, without repetition.

        Raises DataError for streets that are too short, and where no place has a query.
        """
        most = 0
        for _ in range(tries):
            places = self._places(rng)
            if len(places) == self.scheme.stretches * self.scheme.places:
                queries = self._queries(places, rng)
                if len(queries):
                    return places, queries
            most = max(most, len(places))
        s = self.scheme
        raise DataError(
            f"sampling.places: {s.stretches} stretches of {s.places} places, but the "
            f"{len(self.points)} scans of the training region have only {most} places "
            f"{s.spacing[0]:g} to {s.spacing[1]:g} m from each other with other scans within "
            f"{s.positive_radius:g} m; lower sampling.stretches, sampling.places or "
            "sampling.spacing, or enlarge the training region"
        )

    def _places(self, rng: np.random.Generator) -> Scans:
        """The places of all stretches; fewer where there is no room."""
        places: list[int] = []
        maps: dict[int, int] = {}  # the session of each dataset
        for _ in range(self.scheme.stretches if len(self.scans) else 0):
            start = rng.integers(len(self.scans))
            session = maps.setdefault(
                int(self.scans.dataset[start]), int(self.scans.session[start])
            )
            drive = np.flatnonzero(self.scans.session == session)
            drive = np.roll(drive, -int(rng.integers(len(drive))))
            places += self._stretch(drive, places, rng.uniform(*self.scheme.spacing))
        return np.array(places, dtype=np.int64)

    def _stretch(self, drive: Scans, before: list[int], spacing: float) -> list[int]:
        """The first scans of a drive that lie beyond ``spacing`` of each other and those before."""
        points = self.points[drive]
        chosen: list[int] = []
        free = np.ones(len(drive), dtype=np.bool_)
        for place in before:
            free &= np.linalg.norm(points - self.points[place], axis=1) > spacing
        while len(chosen) < self.scheme.places and free.any():
            first = int(free.argmax())
            chosen.append(int(drive[first]))
            free &= np.linalg.norm(points - points[first], axis=1) > spacing
        return chosen

    def _queries(self, places: Scans, rng: np.random.Generator) -> Scans:
        """Random scans at the places, up to ``queries`` for each stretch."""
        taken = set(places.tolist())
        queries: list[Scans] = []
        for stretch in places.reshape(self.scheme.stretches, -1):
            seen = [self.passing(int(place)) for place in stretch]
            pool = [k for k in np.unique(np.concatenate(seen)).tolist() if k not in taken]
            drawn = rng.permutation(np.array(pool, dtype=np.int64))[: self.scheme.queries]
            taken.update(drawn.tolist())
            queries.append(drawn)
        return np.concatenate(queries)

    def passing(self, place: int) -> Scans:
        """The scans at a place of the drive that differs most from the place's own."""
        near = self.near[place][self.near[place] != place]
        session = self.scans.session[near] != self.scans.session[place]
        other_pass = np.abs(self.path[near] - self.path[place]) > self.scheme.pass_apart
        for different in (session, ~session & other_pass):
            if different.any():
                return near[different]
        return near

    def tell_drives(self) -> None:
        """Log at how many scans another session or another pass comes by."""
        session, again = 0, 0
        for place in range(len(self.scans)):
            seen = self.passing(place)
            if (self.scans.session[seen] != self.scans.session[place]).any():
                session += 1
            elif (np.abs(self.path[seen] - self.path[place]) > self.scheme.pass_apart).any():
                again += 1
        n = len(self.scans)
        log.info(
            "queries are of another session at %d, of another pass at %d of %d training scans",
            session,
            again,
            n,
        )
        if session + again == 0:
            log.warning(
                "all queries are of the same pass as their places, which they resemble more than a "
                "later drive would; train on two sessions, or lower sampling.pass_apart"
            )
