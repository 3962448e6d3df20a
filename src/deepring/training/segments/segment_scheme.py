"""The segment scheme: a network learns which thing a segment is of (Locus).

Source: SegMap (Dubé et al., RSS 2018; ethz-asl/segmap), whose identities are of a drive's map.
Here they are told by the poses of the training scans, see `segment_identities`.
"""

import logging
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.methods.network import NetworkMethod, evaluating
from deepring.rasters import Raster, SegmentsRaster
from deepring.rasters.segments import unpack_voxels
from deepring.training.scheme import Step, TrainingScheme, TrainingSet, not_served
from deepring.training.segments.identities import in_world, segment_identities
from deepring.training.segments.segment_augmentation import SegmentAugmentation
from deepring.training.segments.segment_losses import SegmentLoss
from deepring.training.training_scans import TrainingScans

log = logging.getLogger(__name__)

#: Scans whose segments are read at once.
_SCANS = 64


@runtime_checkable
class SegmentDescriber(Protocol):
    """A method that describes a segment."""

    def segment_features(self, voxels: Tensor, extents: Tensor) -> Tensor:
        """Features (n, feature) of voxels (n, x, y, z) and extents (n, 3), metres."""
        ...


class SegmentBatch(NamedTuple):
    """n segments and the things that they are of."""

    voxels: Tensor
    """(n, x, y, z) uint8, 0 or 1."""
    extents: Tensor
    """(n, 3) float32 metres."""
    identity: Tensor
    """(n,) int64, numbers of `segment_identities`."""


@dataclass(frozen=True)
class SegmentScheme(TrainingScheme):
    """Batches of segments; distances in metres.

    Segments of different scans are of one thing where their centres are within ``radius`` of each
    other in the world. Of those that at least ``views`` scans see, the ``identities`` that most
    scans see are learned. With None for
    ``per_epoch``, an epoch has each segment once. ``turned``, ``dropped`` and ``cut`` are those of
    `SegmentAugmentation`.
    """

    loss_type = SegmentLoss

    size: int = 64  # segments of a batch
    per_epoch: int | None = None
    radius: float = 1.0
    views: int = 2
    identities: int = 8192
    turned: bool = True
    dropped: float = 0.1
    cut: float = 0.5

    def __post_init__(self) -> None:
        checks.count("sampling.size", self.size, 2)
        if self.per_epoch is not None:
            checks.count("sampling.per_epoch", self.per_epoch)
        checks.positive("sampling.radius", self.radius, "metres")
        checks.count("sampling.views", self.views, 2)
        checks.count("sampling.identities", self.identities, 2)
        SegmentAugmentation(self.turned, self.dropped, self.cut)

    def expect_loss(self, loss: nn.Module) -> None:
        """Raise ConfigError unless the loss is one of segments and tells enough of them apart."""
        super().expect_loss(loss)
        assert isinstance(loss, SegmentLoss)
        if loss.identities < self.identities:
            raise ConfigError(
                f"loss.identities: {loss.identities}, expected at least "
                f"sampling.identities={self.identities}"
            )

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:
        """Raise ConfigError unless the method describes segments of the loss's sizes."""
        if not isinstance(method, SegmentDescriber):
            expected = "a method with segment_features(voxels, extents), such as Locus"
            raise not_served(self, method, expected)
        assert isinstance(loss, SegmentLoss)
        voxels = torch.zeros(1, *_expect_segments(method.raster).cells, dtype=torch.uint8)
        with evaluating(method), torch.no_grad():
            loss.expect(method.segment_features(voxels, torch.ones(1, 3)), voxels)

    def training_set(self, scans: TrainingScans, seed: int) -> "SegmentSet":
        """Batches of the scans' segments.

        Raises DataError for fewer than two things, ConfigError for another raster.
        """
        return SegmentSet(scans, self, seed)

    def step(self, method: NetworkMethod, loss: SegmentLoss, batch: SegmentBatch) -> Step:
        """Describe the segments, and tell what they are of."""
        assert isinstance(method, SegmentDescriber)
        features = method.segment_features(batch.voxels, batch.extents)
        return loss(features, batch.voxels, batch.identity)


class SegmentSet(TrainingSet[SegmentBatch]):
    """Batches of segments, see `SegmentBatch`."""

    def __init__(self, scans: TrainingScans, scheme: SegmentScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.raster = raster = _expect_segments(scans.rasters.raster)
        self.change = SegmentAugmentation(
            scheme.turned, scheme.dropped, scheme.cut, raster.smallest_voxel
        )
        self.scan, self.row, self.identity = self._identities()
        if not len(self.identity) or self.identity.max() < 1:
            raise DataError(
                f"sampling.radius: the segments of {len(scans)} training scans are of fewer than "
                f"two things that {scheme.views} scans see within {scheme.radius:g} m; raise it, "
                "lower sampling.views or method.raster.least_points, or use more training scans"
            )
        log.info(
            "%d segments of %d things in %d training scans",
            *(len(self.identity), int(self.identity.max()) + 1, len(scans)),
        )

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or max(1, len(self.identity) // self.scheme.size)

    def __getitem__(self, index: int) -> SegmentBatch:
        """Batch ``index``."""
        rng = np.random.default_rng([self.seed, index])
        chosen = self._chosen(index)
        voxels, extents = self._segments(chosen)
        changed = [self.change(*segment, rng) for segment in zip(voxels, extents, strict=True)]
        return SegmentBatch(
            torch.from_numpy(np.stack([grid for grid, _ in changed]).astype(np.uint8)),
            torch.from_numpy(np.stack([lengths for _, lengths in changed])),
            torch.from_numpy(self.identity[chosen]),
        )

    def _chosen(self, index: int) -> NDArray[np.int64]:
        """Numbers of the segments of a batch: all in random order, then again in another."""
        size, n = self.scheme.size, len(self.identity)
        turn, place = np.divmod(np.arange(index * size, (index + 1) * size), n)
        orders = {
            k: np.random.default_rng([self.seed, k, 1]).permutation(n)
            for k in range(int(turn[0]), int(turn[-1]) + 1)
        }
        chosen = [orders[k][m] for k, m in zip(turn.tolist(), place.tolist(), strict=True)]
        return np.array(chosen, dtype=np.int64)

    def _segments(self, chosen: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """Voxels (n, x, y, z) and extents (n, 3) of segments by their numbers."""
        scans, place = np.unique(self.scan[chosen], return_inverse=True)
        segments = self.raster.segments(self.scans.rasters[scans])
        rows = torch.from_numpy(place), torch.from_numpy(self.row[chosen])
        voxels = unpack_voxels(segments.bits[rows], self.raster.cells)
        return voxels.numpy().astype(np.bool_), segments.extents[rows].numpy()

    def _identities(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Scan, row of the raster and identity of each segment that is learned, (n,) each."""
        places, centres = [], []
        for start in range(0, len(self.scans), _SCANS):
            segments = self.raster.segments(self.scans.rasters[start : start + _SCANS])
            scan, row = segments.present.nonzero(as_tuple=True)
            places.append((scan.numpy() + start, row.numpy()))
            centres.append(segments.centres[segments.present].numpy())
        scan, row = np.concatenate(places, axis=1)
        world = in_world(
            np.concatenate(centres), self.scans.positions[scan], self.scans.headings[scan]
        )
        apart = np.column_stack([world, self.scans.dataset[scan] * 1e6])
        identity = segment_identities(apart, scan, self.scheme.radius)
        seen = np.bincount(identity[identity >= 0], minlength=1)[identity] >= self.scheme.views
        learned = seen & (identity >= 0) & (identity < self.scheme.identities)
        return scan[learned], row[learned], identity[learned]


def _expect_segments(raster: Raster) -> SegmentsRaster:
    if not isinstance(raster, SegmentsRaster):
        raise ConfigError(
            f"sampling: SegmentScheme, but the method takes a {type(raster).__name__}, "
            "expected a SegmentsRaster; choose another sampling, or method=locus"
        )
    return raster
