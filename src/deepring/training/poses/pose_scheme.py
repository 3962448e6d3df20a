"""The pose scheme: pairs of one place from two passes, each scan moved at random (LCDNet).

Source: Cattaneo, Vaghi, Valada, T-RO 2022, Sec. III-D and IV.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring import checks
from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.spacing import path_lengths
from deepring.errors import ConfigError, DataError
from deepring.methods.lcdnet.pose_head import Matches
from deepring.methods.network import NetworkMethod
from deepring.rasters import Raster
from deepring.training.poses.pose_losses import PoseLoss, PosePairs
from deepring.training.scheme import Step, TrainingScheme, TrainingSet, not_served
from deepring.training.training_scans import TrainingScans, check_radii, within


@runtime_checkable
class PoseNetwork(Protocol):
    """A network that describes scans and matches the points of two."""

    def encode(self, rasters: Tensor) -> Any:
        """What it makes of scans (b, *raster.shape): tensors (b, ...), named, among them
        ``vectors`` (b, d).
        """
        ...

    def match(self, first: Any, second: Any) -> Matches:
        """Where the points of the first scans are in the second."""
        ...


class PoseBatch(NamedTuple):
    """n pairs of one place: a scan of each, then their partners in the same order."""

    rasters: Tensor
    """(2 n, *raster.shape)."""
    transforms: Tensor
    """(n, 4, 4) float64, carry the partners' points onto those of the first scans."""
    negatives: Tensor
    """(n, 2 n) bool: scans at other places than the first scan of each pair."""
    lots: Tensor
    """(n, 2 n) float32 in [0, 1), random."""


@dataclass(frozen=True)
class PoseScheme(TrainingScheme):
    """Pairs with a pose; distances in metres, angles in degrees.

    The two scans of a pair lie within ``positive_radius``, and are of two sessions or more than
    ``pass_apart`` metres of path apart. Scans beyond ``negative_radius`` are of other places. With
    None for ``per_epoch``, an epoch has as many batches as the scans fill.

    Every scan is moved before it becomes voxels: turned by up to ``turn`` about z and ``tilt``
    about x and y, then shifted by up to ``shift`` in x and y and ``lift`` in z.
    """

    loss_type = PoseLoss

    pairs: int = 6  # of a batch
    per_epoch: int | None = None
    positive_radius: float = 4.0
    negative_radius: float = 10.0
    pass_apart: float = 50.0
    turn: float = 180.0
    tilt: float = 3.0
    shift: float = 1.5
    lift: float = 0.25

    def __post_init__(self) -> None:
        checks.count("sampling.pairs", self.pairs, 2)
        if self.per_epoch is not None:
            checks.count("sampling.per_epoch", self.per_epoch)
        check_radii(self.positive_radius, self.negative_radius)
        checks.at_least("sampling.pass_apart", self.pass_apart, 0, "metres")
        checks.between("sampling.turn", self.turn, 0, 180, "degrees")
        checks.between("sampling.tilt", self.tilt, 0, 90, "degrees")
        checks.at_least("sampling.shift", self.shift, 0, "metres")
        checks.at_least("sampling.lift", self.lift, 0, "metres")

    def training_set(self, scans: TrainingScans, seed: int) -> "PoseSet":
        """Batches of the scans.

        Raises DataError where there are too few pairs, and ConfigError for a raster whose points
        cannot be moved.
        """
        return PoseSet(scans, self, seed)

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:  # noqa: ARG002
        """Raise ConfigError unless the method matches points, and its raster can be moved."""
        if not isinstance(method, PoseNetwork):
            raise not_served(self, method, "a method with encode and match, such as LCDNet")
        _expect_movable(method.raster)

    def step(self, method: NetworkMethod, loss: PoseLoss, batch: PoseBatch) -> Step:
        """Describe all scans at once, and match the partners with the first scans."""
        assert isinstance(method, PoseNetwork)
        encoded = method.encode(batch.rasters)
        first, second = (type(encoded)(*(x.chunk(2)[k] for x in encoded)) for k in (0, 1))
        matches = method.match(second, first)
        pairs = PosePairs(encoded.vectors, batch.negatives, batch.lots, matches, batch.transforms)
        return loss(pairs)


class PoseSet(TrainingSet[PoseBatch]):
    """Batches of pairs with a pose, see `PoseBatch`."""

    def __init__(self, scans: TrainingScans, scheme: PoseScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        _expect_movable(scans.rasters.raster)
        if scans.frames is None:
            raise DataError("scans: without frames, expected those of scans whose poses are known")
        self.frames = scans.frames
        self.points = scans.points
        self.partners = self._partners()
        self.anchors = np.flatnonzero([len(near) > 0 for near in self.partners])
        if len(self.anchors) < scheme.pairs:
            raise DataError(
                f"sampling.pairs: {scheme.pairs}, but only {len(self.anchors)} of {len(scans)} "
                f"training scans have another within {scheme.positive_radius:g} m from a later "
                "pass; raise sampling.positive_radius, lower sampling.pass_apart or "
                "sampling.pairs, or use more training scans"
            )

    def _partners(self) -> list[NDArray[np.int64]]:
        """Numbers of the scans at each scan's place from another pass."""
        scans, path = self.scans, np.zeros(len(self.scans))
        for session in np.unique(scans.session):
            of_session = scans.session == session
            path[of_session] = path_lengths(scans.positions[of_session])
        partners = []
        for k, near in enumerate(within(self.points, self.scheme.positive_radius)):
            other = scans.session[near] != scans.session[k]
            later = np.abs(path[near] - path[k]) > self.scheme.pass_apart
            partners.append(near[(other | later) & (near != k)])
        return partners

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or max(1, len(self.anchors) // self.scheme.pairs)

    def __getitem__(self, index: int) -> PoseBatch:
        """Batch ``index``."""
        rng = np.random.default_rng([self.seed, index])
        first = rng.choice(self.anchors, self.scheme.pairs, replace=False)
        second = np.array([rng.choice(self.partners[k]) for k in first])
        numbers = np.concatenate([first, second])
        moves = self.moves(len(numbers), rng)
        raster: Any = self.scans.rasters.raster
        rasters = raster.moved(self.scans.rasters[numbers], torch.from_numpy(moves))
        # A point of the partner as it is moved, in its own frame, in the world, in the first's.
        frames = self.frames[numbers] @ np.linalg.inv(moves)
        here, there = frames[: len(first)], frames[len(first) :]
        apart = np.linalg.norm(self.points[first][:, None] - self.points[numbers], axis=-1)
        return PoseBatch(
            rasters,
            torch.from_numpy(np.linalg.inv(here) @ there),
            torch.from_numpy(apart > self.scheme.negative_radius),
            torch.from_numpy(rng.random(apart.shape, dtype=np.float32)),
        )

    def moves(self, number: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Random rigid transforms (n, 4, 4), which the points of scans are moved by."""
        s = self.scheme
        ends = np.array([*np.deg2rad([s.tilt, s.tilt, s.turn]), s.shift, s.shift, s.lift])
        roll, pitch, yaw, *shift = rng.uniform(-ends, ends, (number, 6)).T
        return pose_from(rotation_from_rpy(roll, pitch, yaw), np.stack(shift, axis=1))


def _expect_movable(raster: Raster) -> None:
    if not hasattr(raster, "moved"):
        raise ConfigError(
            f"sampling: PoseScheme, but the method takes a {type(raster).__name__}, expected "
            "points that can be moved, as LCDNet takes; choose another sampling or method"
        )
