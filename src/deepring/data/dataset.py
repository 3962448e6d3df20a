"""A dataset as a config states it: sessions, spacings, regions, and what to train and test on."""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.checks import one_of
from deepring.data.readers import open_session
from deepring.data.regions import Region, Shape, parse_region
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.data.spacing import far_half_plane, revisits, sample_by_distance
from deepring.errors import ConfigError, DataError

log = logging.getLogger(__name__)


@dataclass
class Spacing:
    """Metres between the scans that are used."""

    database: float = 20.0
    query: float = 5.0
    train: float = 1.0


@dataclass
class Regions:
    """Regions in ground-truth coordinates, as `parse_region` takes them; None is everywhere.

    ``validation`` is cut out of ``train``; None takes the far ``validation_share`` of it along
    its longest direction. Training keeps ``margin`` metres away from validation scans.
    """

    train: Any = None
    validation: Any = None
    test: Any = None
    validation_share: float = 0.15
    margin: float = 50.0


@dataclass
class DatasetConfig:
    """One dataset. Every value is a config value: ``data.root``, ``data.database``, ..."""

    name: str = "???"
    format: str = "???"
    root: str = "???"
    database: str | None = None
    query: str | None = None
    spacing: Spacing = field(default_factory=Spacing)
    regions: Regions = field(default_factory=Regions)
    #: 'sessions': database and query are two sessions. 'revisits': one session; its first
    #: passes are the database, passes over ground first seen revisit_apart metres of path
    #: earlier are the queries.
    split: str = "sessions"
    revisit_radius: float = 10.0
    revisit_apart: float = 100.0
    #: z of the ground under the sensor in the scan's frame, metres; None takes the session's.
    ground_z: float | None = 0.0
    #: Seed of a random turn of each query; None turns none.
    query_turn_seed: int | None = None
    #: Further options of the reader, such as pose_tolerance.
    reader: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RetrievalSet:
    """Queries and the database they are looked up in."""

    name: str
    region: str
    database: ScanSet
    query: ScanSet


class PlaceDataset:
    """The sessions of a `DatasetConfig`, opened when first needed.

    ``key`` is where the config stands, such as 'test_data.nclt': messages begin with it. Raises
    ConfigError for a value of the config, and DataError for data, that cannot be used.
    """

    def __init__(self, config: DatasetConfig, key: str = "data") -> None:
        one_of(f"{key}.split", config.split, ("sessions", "revisits"))
        self.config = config
        self.key = key
        self.name = config.name

    @cached_property
    def database(self) -> Session:
        """The session that maps are made of."""
        return self._open(self.config.database)

    @cached_property
    def query(self) -> Session:
        """The session that queries come from; the same one under 'revisits'."""
        if self.config.split == "revisits":
            return self.database
        session = self._open(self.config.query)
        if session.name == self.database.name:
            raise ConfigError(
                f"{self.key}.query: {session.name} is {self.key}.database too, and every query "
                "would find itself; name another session, or take split 'revisits'"
            )
        return session

    def _open(self, name: str | None) -> Session:
        c = self.config
        session = open_session(c.format, c.root, name, **c.reader)
        skipped = session.skipped
        if str(skipped):
            level = logging.WARNING if skipped.broken or skipped.without_pose else logging.INFO
            log.log(level, "%s %s: left out %s", c.name, session.name, skipped)
        return session

    @cached_property
    def _validation(self) -> Shape | None:
        """The validation region, without regard to the training region it is cut out of."""
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
        """The region that the config states; see `parse_region`."""
        return parse_region(getattr(self.config.regions, name), f"{self.key}.regions.{name}")

    @property
    def has_validation(self) -> bool:
        """True where some of the training region is left to validation."""
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
                raise ConfigError(f"{self.key}.regions: no validation split, since its share is 0")
            return inside
        if region == "validation":
            return inside & self._validation.contains(positions)
        every = np.concatenate([self.database.ground_truth, self.query.ground_truth])
        validation = every[train.contains(every) & self._validation.contains(every)]
        from scipy.spatial import KDTree

        apart, _ = KDTree(validation).query(positions)
        return inside & (apart > self.config.regions.margin)

    def training(self) -> list[ScanSet]:
        """The scans that classes are drawn from: of both sessions, in the training region."""
        sessions = [self.database]
        if self.config.split == "sessions":
            sessions.append(self.query)
        spacing = self.config.spacing.train
        return [self._scans(session, "train", spacing) for session in sessions]

    def retrieval(self, region: str) -> RetrievalSet:
        """Database and queries of 'validation', 'test' or 'whole'."""
        spacing = self.config.spacing
        first = again = None
        if self.config.split == "revisits":
            again = revisits(
                self.query.positions, self.config.revisit_radius, self.config.revisit_apart
            )
            first = ~again
        database = self._scans(self.database, region, spacing.database, first)
        query = self._scans(self.query, region, spacing.query, again, self.config.query_turn_seed)
        return RetrievalSet(self.name, region, database, query)

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
                f"{self.key}.split: the scans of session {session.name} in region {region!r} do "
                "not split into first passes and revisits, which are within "
                f"revisit_radius={c.revisit_radius:g} m of a scan more than "
                f"revisit_apart={c.revisit_apart:g} m of path earlier; change these or the "
                "region"
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
                f"{self.key}.ground_z: null, but session {session.name} of {self.name} does not "
                "say how high its sensor is; set it to z of the ground in the scans' frame, metres"
            )
        return ground_z

    def _empty(self, region: str, session: Session) -> DataError:
        low, high = session.ground_truth.min(axis=0), session.ground_truth.max(axis=0)
        return DataError(
            f"{self.key}.regions.{region}: no usable scan of session {session.name} of {self.name} "
            f"lies in it; its ground truth spans [{low[0]:.1f}, {low[1]:.1f}] to "
            f"[{high[0]:.1f}, {high[1]:.1f}]; mend the region or take another session"
        )


def distances_between(positions: NDArray[np.float64], database: ScanSet) -> torch.Tensor:
    """Distances (q, d) float32 metres from (q, 2) world positions, taken in float64."""
    offset = positions[:, None] - database.positions[None]
    return torch.from_numpy(np.hypot(offset[..., 0], offset[..., 1])).float()
