"""The scheme of corresponding points: two scans whose relative pose is known, each moved at random.

Source: Du, Wang, Cremers, ECCV 2020, Sec. 3 and 4 (JuanDuGit/DH3D).
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring import checks
from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.errors import ConfigError, DataError
from deepring.methods.dh3d import LocalPoints
from deepring.methods.network import NetworkMethod
from deepring.nn.neighbourhoods import farthest_points, gathered
from deepring.rasters import PointsRaster, Raster
from deepring.training.correspondences.correspondence_losses import (
    CorrespondenceLoss,
    Correspondences,
)
from deepring.training.scheme import Step, TrainingScheme, TrainingSet, not_served
from deepring.training.training_scans import TrainingScans, within

Partners = Literal["copies", "scans"]
"""The second scan of a pair: a copy of the first, as published, or another scan of the place."""


@runtime_checkable
class LocalNetwork(Protocol):
    """A network that describes the points of a scan."""

    def local_points(self, rasters: Tensor) -> LocalPoints:
        """Points, local descriptors and scores of scans (b, n, 3)."""
        ...


class CorrespondenceBatch(NamedTuple):
    """n pairs: a scan of each, then their partners in the same order."""

    rasters: Tensor
    """(2 n, points, 3) float32, in the unit of the raster, moved."""
    transforms: Tensor
    """(n, 4, 4) float32: carry the partners' points onto those of the first scans, metres."""


@dataclass(frozen=True)
class CorrespondenceScheme(TrainingScheme):
    """Pairs of scans that see the same points.

    Each scan is turned about z by any angle, tilted about x and y by a normal angle of ``tilt``
    radians, at most three times that, and its points are moved by normal noise of ``jitter`` metres
    an axis, at most twice that. Partners are ``copies`` or other ``scans`` within ``place_radius``,
    which poses on one plane bring together. ``points`` of a scan, far from each other, are compared
    with the partner's points nearest to them; ``around`` of them are a point's surroundings.
    """

    loss_type = CorrespondenceLoss

    pairs: int = 6  # of a batch
    per_epoch: int = 1000  # batches
    partners: Partners = "copies"  # or scans
    place_radius: float = 10.0  # metres
    points: int = 512
    around: int = 10
    tilt: float = 0.06
    jitter: float = 0.05

    def __post_init__(self) -> None:
        for name in ("pairs", "per_epoch", "around"):
            checks.count(f"sampling.{name}", getattr(self, name))
        checks.count("sampling.points", self.points, max(2, self.around))
        checks.one_of("sampling.partners", self.partners, Partners)
        checks.positive("sampling.place_radius", self.place_radius, "metres")
        checks.at_least("sampling.tilt", self.tilt, 0, "radians")
        checks.at_least("sampling.jitter", self.jitter, 0, "metres")

    def training_set(self, scans: TrainingScans, seed: int) -> "CorrespondenceSet":
        """Pairs of the scans. Raises ConfigError for a raster of another kind than points."""
        return CorrespondenceSet(scans, self, seed)

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:  # noqa: ARG002
        """Raise ConfigError unless the method describes points, and takes enough of them."""
        if not isinstance(method, LocalNetwork):
            raise not_served(self, method, "a method with local_points(rasters), such as DH3D")
        self.expect_points(method.raster)

    def expect_points(self, raster: Raster) -> PointsRaster:
        """The raster. Raises ConfigError unless it is of points, and of enough of them."""
        if not isinstance(raster, PointsRaster):
            raise ConfigError(
                f"sampling: CorrespondenceScheme, expected a method of points, not of "
                f"{type(raster).__name__}; choose another method or sampling"
            )
        if self.points > raster.count:
            raise ConfigError(
                f"sampling.points: {self.points}, expected at most the {raster.count} points of "
                "a scan, method.raster.count"
            )
        return raster

    def step(
        self, method: NetworkMethod, loss: CorrespondenceLoss, batch: CorrespondenceBatch
    ) -> Step:
        """Describe the points of both scans, and compare those that lie together."""
        assert isinstance(method, LocalNetwork)
        local = method.local_points(batch.rasters)
        first, second = (LocalPoints(*(part[k] for part in _halves(local))) for k in (0, 1))
        rotation, shift = batch.transforms[:, :3, :3], batch.transforms[:, None, :3, 3]
        carried = second.points @ rotation.transpose(1, 2) + shift
        chosen = farthest_points(first.points, self.points)
        points = gathered(first.points, chosen)
        partners = torch.cdist(points, carried).argmin(dim=-1)
        descriptors = gathered(first.descriptors, chosen)
        others = gathered(second.descriptors, partners)
        among = torch.cdist(points, points).topk(self.around, dim=-1, largest=False).indices
        # The root's gradient is infinite at 0.
        squares = 2 - 2 * descriptors @ others.transpose(1, 2)
        return loss(
            Correspondences(
                (squares.clamp_min(0) + 1e-6).sqrt(),
                torch.cdist(points, gathered(carried, partners)),
                first.scores.gather(1, chosen),
                among,
            )
        )


class CorrespondenceSet(TrainingSet[CorrespondenceBatch]):
    """Batches of pairs, see `CorrespondenceBatch`."""

    def __init__(self, scans: TrainingScans, scheme: CorrespondenceScheme, seed: int) -> None:
        self.extent = scheme.expect_points(scans.rasters.raster).extent
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.near = within(scans.points, scheme.place_radius)
        self.usable = np.arange(len(scans))
        if scheme.partners == "scans":
            self.usable = np.flatnonzero([len(near) > 1 for near in self.near])
        if not len(self.usable):
            raise DataError(
                f"sampling.place_radius: none of {len(scans)} training scans has another within "
                f"{scheme.place_radius:g} m; raise it, or use more training scans"
            )

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch

    def __getitem__(self, index: int) -> CorrespondenceBatch:
        """Batch ``index``."""
        rng = np.random.default_rng([self.seed, index])
        pairs = self.sample(rng)
        moves = np.stack([self._turned(rng) for _ in pairs.ravel()]).reshape(*pairs.shape, 4, 4)
        points = self.scans.rasters[pairs.T.ravel()].double() * self.extent
        points = points + self._noise(tuple(points.shape), rng)
        rotations = torch.from_numpy(moves[:, :, :3, :3].swapaxes(0, 1).reshape(-1, 3, 3))
        moved = points @ rotations.transpose(1, 2)
        poses = np.stack([self.scans.level_pose(scan, partner) for scan, partner in pairs])
        transforms = moves[:, 0] @ poses @ np.linalg.inv(moves[:, 1])
        return CorrespondenceBatch(
            (moved / self.extent).float(), torch.from_numpy(transforms).float()
        )

    def sample(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Numbers of two scans for each pair, (pairs, 2)."""
        first = rng.choice(self.usable, self.scheme.pairs)
        if self.scheme.partners == "copies":
            return np.stack([first, first], axis=1)
        partners = [rng.choice(self.near[k][self.near[k] != k]) for k in first]
        return np.stack([first, np.array(partners, dtype=np.int64)], axis=1)

    def _turned(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """A random rotation as a pose (4, 4)."""
        limit = 3 * self.scheme.tilt
        roll, pitch = np.clip(rng.normal(0, 1, 2) * self.scheme.tilt, -limit, limit)
        return pose_from(rotation_from_rpy(roll, pitch, rng.uniform(-np.pi, np.pi)), np.zeros(3))

    def _noise(self, shape: tuple[int, ...], rng: np.random.Generator) -> Tensor:
        jitter = self.scheme.jitter
        noise = rng.standard_normal(shape, dtype=np.float32) * jitter
        return torch.from_numpy(noise.clip(-2 * jitter, 2 * jitter))


def _halves(local: LocalPoints) -> list[tuple[Tensor, ...]]:
    return [part.chunk(2) for part in local]
