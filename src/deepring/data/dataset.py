"""A dataset from its config: sessions, spacings, regions, and scans for training and test."""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.checks import one_of
from deepring.data.inspection.session import expect_usable
from deepring.data.online import Earlier, check_earlier, first_too_recent
from deepring.data.readers import open_session
from deepring.data.regions import Region, Shape, parse_region
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.data.spacing import far_half_plane, revisits, sample_by_distance
from deepring.errors import ConfigError, DataError
from deepring.text import printable

log = logging.getLogger(__name__)


@dataclass
class Spacing:
    """Metres between the scans in use."""

    database: float = 20.0  # between places
    query: float = 5.0  # between queries
    train: float = 1.0  # between training scans; 0 takes all, here and above


@dataclass
class Regions:
    """Regions in ground-truth coordinates, as for `parse_region`; None is the whole plane.

    ``validation`` is a part of ``train``; None is the far ``validation_share`` of it along its
    longest direction. Training scans are more than ``margin`` metres from validation scans.
    """

    train: Any = None  # of the scans that are trained on
    validation: Any = None  # a part of it; None: its far end
    test: Any = None  # of places and queries
    validation_share: float = 0.15  # of the training region, where validation is None
    margin: float = 50.0  # metres from training to validation scans


@dataclass
class DatasetConfig:
    """The config of one dataset."""

    name: str = "???"  # in tables
    format: str = "???"  # the layout: nclt, mulran, kitti, helipr, custom
    root: str = "???"  # the dataset's folder, or a drive.yaml
    database: str | None = None  # the session of the places; None: the only one
    query: str | None = None  # the session of the queries
    spacing: Spacing = field(default_factory=Spacing)
    regions: Regions = field(default_factory=Regions)
    #: 'sessions': database and query are two sessions. 'revisits': one session, with its first
    #: passes as the database and later passes as queries, see `deepring.data.spacing.revisits`.
    #: 'online': one session, each query looked up among the places that are ``earlier`` enough.
    split: str = "sessions"
    earlier: Earlier = field(default_factory=Earlier)
    #: Metres within which a later pass revisits an earlier one, in 'revisits'.
    revisit_radius: float = 10.0
    #: Metres of path that lie at least between two passes.
    revisit_apart: float = 100.0
    #: z of the ground under the sensor in the scan's frame, metres; None uses the session's value.
    ground_z: float | None = 0.0
    #: Random seed of a turn of each query; None does not turn queries.
    query_turn_seed: int | None = None
    #: Further options of the reader, e.g. pose_tolerance.
    reader: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RetrievalSet:
    """Queries and the database in which they are searched."""

    name: str
    region: str
    database: ScanSet
    query: ScanSet
    before: NDArray[np.int64] | None = None
    """(q,) where both are of one drive and queries are online: each is compared with the places
    whose scans come before this one of the session, and never with none. None: with all places."""

    @property
    def searched(self) -> NDArray[np.int64] | None:
        """With how many of the first places each query is compared, (q,); None: with all."""
        if self.before is None:
            return None
        return np.searchsorted(self.database.indices, self.before)

    def among(self, database: ScanSet, query: ScanSet) -> "RetrievalSet":
        """Some of the scans of both sides, without queries that have no place any more."""
        if self.before is None:
            return RetrievalSet(self.name, self.region, database, query)
        before = self.before[np.searchsorted(self.query.indices, query.indices)]
        some = before > database.indices[0] if len(database) else np.zeros(len(query), np.bool_)
        return RetrievalSet(self.name, self.region, database, query.subset(some), before[some])


class PlaceDataset:
    """The sessions of a `DatasetConfig`, opened on first use.

    ``key`` is the dataset's config key in messages, e.g. 'test_data.nclt'. Raises ConfigError for
    invalid values of the config, and DataError for unusable data.
    """

    def __init__(self, config: DatasetConfig, key: str = "data") -> None:
        one_of(f"{key}.split", config.split, ("sessions", "revisits", "online"))
        check_earlier(config.earlier, f"{key}.earlier", config.split == "online")
        self.config = config
        self.key = key
        self.name = config.name

    @cached_property
    def database(self) -> Session:
        """The session of the database."""
        return self._open(self.config.database)

    @cached_property
    def query(self) -> Session:
        """The session of the queries; with split 'revisits' and 'online', that of the database."""
        if self.config.split != "sessions":
            return self.database
        session = self._open(self.config.query)
        if session.name == self.database.name:
            raise ConfigError(
                f"{self.key}.query: {session.name} is also {self.key}.database, so that every "
                f"query would find itself; choose another session, or {self.key}.split "
                "'revisits' or 'online'"
            )
        return session

    def _open(self, name: str | None) -> Session:
        c = self.config
        session = open_session(c.format, c.root, name, **c.reader)
        skipped = session.skipped
        if str(skipped):
            level = logging.WARNING if skipped.broken or skipped.without_pose else logging.INFO
            log.log(level, "%s %s: skipped %s", c.name, printable(session.name), skipped)
        ground_z = session.ground_z if c.ground_z is None else c.ground_z
        for finding in expect_usable(session, ground_z):
            log.warning("%s %s: %s", c.name, printable(session.name), printable(str(finding)))
        return session

    @cached_property
    def _validation(self) -> Shape | None:
        """The validation region, not yet intersected with the training region."""
        c = self.config.regions
        if c.validation is not None:
            return self._region("validation")
        if not 0 <= c.validation_share < 1:
            raise ConfigError(
                f"{self.key}.regions.validation_share: {c.validation_share}, expected a share of "
                "at least 0 and below 1"
            )
        if c.validation_share == 0:
            return None
        positions = self.database.ground_truth
        inside = self._region("train").contains(positions)
        if not inside.any():
            raise self._empty("train", self.database)
        return far_half_plane(positions[inside], c.validation_share)

    def _region(self, name: str) -> Region:
        """A region of the config; see `parse_region`."""
        return parse_region(getattr(self.config.regions, name), f"{self.key}.regions.{name}")

    @property
    def has_validation(self) -> bool:
        """True if a part of the training region is for validation."""
        return self._validation is not None

    def mask(self, region: str, session: Session) -> NDArray[np.bool_]:
        """Mask (n,) of the scans of a session in 'train', 'validation', 'test' or 'whole'."""
        positions = session.ground_truth
        if region == "whole":
            return np.ones(len(session), dtype=np.bool_)
        if region == "test":
            return self._region("test").contains(positions)
        train = self._region("train")
        inside = train.contains(positions)
        if self._validation is None:
            if region == "validation":
                raise ConfigError(
                    f"{self.key}.regions.validation_share: 0, expected more for validation"
                )
            return inside
        if region == "validation":
            return inside & self._validation.contains(positions)
        everywhere = np.concatenate([self.database.ground_truth, self.query.ground_truth])
        validation = everywhere[train.contains(everywhere) & self._validation.contains(everywhere)]
        from scipy.spatial import KDTree

        distances, _ = KDTree(validation).query(positions)
        return inside & (distances > self.config.regions.margin)

    def training(self) -> list[ScanSet]:
        """The training scans of both sessions, in the training region."""
        sessions = [self.database]
        if self.config.split == "sessions":
            sessions.append(self.query)
        spacing = self.config.spacing.train
        return [self._scans(session, "train", spacing) for session in sessions]

    def retrieval(self, region: str) -> RetrievalSet:
        """Database and queries of 'validation', 'test' or 'whole'."""
        spacing = self.config.spacing
        first = later = None
        if self.config.split == "revisits":
            later = revisits(
                self.query.positions, self.config.revisit_radius, self.config.revisit_apart
            )
            first = ~later
        database = self._scans(self.database, region, spacing.database, first)
        query = self._scans(self.query, region, spacing.query, later, self.config.query_turn_seed)
        if self.config.split == "online":
            return self._online(region, database, query)
        return RetrievalSet(self.name, region, database, query)

    def _online(self, region: str, database: ScanSet, query: ScanSet) -> RetrievalSet:
        """The queries that have any place, each with those that are earlier enough."""
        key, earlier = f"{self.key}.earlier", self.config.earlier
        before = first_too_recent(self.database, database.indices, query.indices, earlier, key)
        online = RetrievalSet(self.name, region, database, query, before).among(database, query)
        if not len(online.query):
            given = {name: value for name, value in vars(earlier).items() if value is not None}
            raise ConfigError(
                f"{key}: {given}, but none of {len(query)} queries of session "
                f"{self.database.name} in region {region!r} has a place that much earlier; take "
                "less, or a longer drive"
            )
        return online

    def _scans(
        self,
        session: Session,
        region: str,
        spacing: float,
        among: NDArray[np.bool_] | None = None,
        turn_seed: int | None = None,
    ) -> ScanSet:
        mask = self.mask(region, session)
        if not mask.any():
            raise self._empty(region, session)
        if among is not None:
            mask &= among
        if not mask.any():
            c = self.config
            raise ConfigError(
                f"{self.key}.split: 'revisits', but the scans of session {session.name} in region "
                f"{region!r} are all first passes or all revisits (within revisit_radius="
                f"{c.revisit_radius:g} m of a scan more than revisit_apart={c.revisit_apart:g} m "
                "of path earlier); change these values or the region"
            )
        indices = sample_by_distance(session.positions, spacing, mask)
        turns = None
        if turn_seed is not None:
            turns = np.random.default_rng(turn_seed).uniform(0, 2 * np.pi, len(indices))
        return ScanSet(session, indices, self._ground_z(session), turns)

    def _ground_z(self, session: Session) -> float:
        ground_z = session.ground_z if self.config.ground_z is None else self.config.ground_z
        if ground_z is None:
            raise ConfigError(
                f"{self.key}.ground_z: null, but session {session.name} of {self.name} has no "
                "sensor height; set it to z of the ground in the scans' frame, metres"
            )
        return ground_z

    def _empty(self, region: str, session: Session) -> DataError:
        low, high = session.ground_truth.min(axis=0), session.ground_truth.max(axis=0)
        return DataError(
            f"{self.key}.regions.{region}: contains no usable scan of session {session.name} of "
            f"{self.name}, whose ground truth spans [{low[0]:.1f}, {low[1]:.1f}] to "
            f"[{high[0]:.1f}, {high[1]:.1f}]; change the region or choose another session"
        )


def distances_between(positions: NDArray[np.float64], database: ScanSet) -> torch.Tensor:
    """Distances (q, d) float32, metres, from world positions (q, 2), computed in float64."""
    offset = positions[:, None] - database.positions[None]
    return torch.from_numpy(np.hypot(offset[..., 0], offset[..., 1])).float()
