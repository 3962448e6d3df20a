"""Pairs of scans with their overlap and the turn between them (OverlapNet: Chen et al., 2020)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring import checks
from deepring.core.rigid import wrap_angle
from deepring.errors import ConfigError, DataError
from deepring.methods.network import NetworkMethod
from deepring.progress import progress_bar
from deepring.rasters import RangeNormalRaster, Raster
from deepring.training.pairs.overlap_loss import OverlapAndTurn, OverlapHeads, OverlapPairs
from deepring.training.scheme import Step, TrainingScheme, TrainingSet, not_served
from deepring.training.training_scans import TrainingScans, within

#: Scans whose ranges are unpacked at once, and pairs whose overlaps are computed at once.
_SCANS, _PAIRS = 64, 512


class OverlapBatch(NamedTuple):
    """n pairs: a scan of each, then their partners in the same order."""

    rasters: Tensor
    """(2 n, *raster.shape)."""
    overlap: Tensor
    """(n,) float32: how much of the first its partner sees too."""
    turn: Tensor
    """(n,) float32 radians in [-π, π), of the points from the partner to the first."""


@dataclass(frozen=True)
class OverlapScheme(TrainingScheme):
    """Pairs of scans, drawn evenly over their overlap.

    Each scan is paired with ``partners`` others of its dataset, half of them within ``radius``
    metres where there are that many; the overlaps of these pairs are computed once, see
    `RangeNormalRaster.overlaps`. The ``pairs`` of a batch are drawn from ``bins`` equal parts of
    [0, 1], of those that hold any pair, each as probable as another. With None for ``per_epoch``,
    an epoch has as many batches as the scans fill. ``turned`` turns every scan by a random number
    of sectors of its own.
    """

    loss_type = OverlapAndTurn

    pairs: int = 16
    per_epoch: int | None = None
    partners: int = 8
    radius: float = 15.0
    bins: int = 10
    tolerance: float = 1.0  # metres by which ranges that overlap differ at most
    around: int = 1  # cells either way in which a range is looked for
    turned: bool = False

    def __post_init__(self) -> None:
        for name in ("pairs", "partners", "bins"):
            checks.count(f"sampling.{name}", getattr(self, name))
        checks.count("sampling.around", self.around, 0)
        if self.per_epoch is not None:
            checks.count("sampling.per_epoch", self.per_epoch)
        for name in ("radius", "tolerance"):
            checks.positive(f"sampling.{name}", getattr(self, name), "metres")

    def training_set(self, scans: TrainingScans, seed: int) -> "OverlapSet":
        """Batches of the scans. Raises DataError where no two scans are of one dataset."""
        return OverlapSet(scans, self, seed)

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:  # noqa: ARG002
        """Raise ConfigError unless the method tells overlaps and turns of range images."""
        if not isinstance(method, OverlapHeads):
            expected = "a method with overlap_logits and turn_curves, such as OverlapNet"
            raise not_served(self, method, expected)
        _expect_ranges(method.raster)

    def step(self, method: NetworkMethod, loss: OverlapAndTurn, batch: OverlapBatch) -> Step:
        """Describe both scans of all pairs at once."""
        assert isinstance(method, OverlapHeads)
        first, second = method(batch.rasters).chunk(2)
        logits, curves = method.overlap_logits(first, second), method.turn_curves(first, second)
        return loss(OverlapPairs(logits, curves, batch.overlap, batch.turn))


class OverlapSet(TrainingSet[OverlapBatch]):
    """Batches of pairs, see `OverlapBatch`."""

    def __init__(self, scans: TrainingScans, scheme: OverlapScheme, seed: int) -> None:
        raster = _expect_ranges(scans.rasters.raster)
        self.scans, self.scheme, self.seed, self.raster = scans, scheme, seed, raster
        self.pairs = drawn_pairs(scans, scheme, np.random.default_rng([seed]))
        self.overlaps = self._overlaps()
        part = np.minimum((self.overlaps * scheme.bins).astype(np.int64), scheme.bins - 1)
        parts = [np.flatnonzero(part == k) for k in range(scheme.bins)]
        self.parts = [numbers for numbers in parts if len(numbers)]

    def _overlaps(self) -> NDArray[np.float64]:
        """Overlaps of the pairs (p,)."""
        rows = range(0, len(self.scans), _SCANS)
        images = [self.scans.rasters[k : k + _SCANS][:, 0].numpy() for k in rows]
        ranges, found = np.concatenate(images).astype(np.float32), []
        with progress_bar("overlaps of training scans") as bar:
            for k in range(0, len(self.pairs), _PAIRS):
                pairs = self.pairs[k : k + _PAIRS]
                poses = np.stack([self.scans.level_pose(*pair) for pair in pairs])
                limits = self.scheme.tolerance, self.scheme.around
                found.append(self.raster.overlaps(ranges, pairs, poses, *limits))
                bar(k + len(pairs), len(self.pairs))
        return np.concatenate(found)

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or max(1, len(self.scans) // (2 * self.scheme.pairs))

    def __getitem__(self, index: int) -> OverlapBatch:
        """Batch ``index``."""
        rng = np.random.default_rng([self.seed, index])
        parts = rng.integers(len(self.parts), size=self.scheme.pairs)
        numbers = np.array([rng.choice(self.parts[part]) for part in parts])
        first, second = self.pairs[numbers].T
        rasters = self.scans.rasters[np.concatenate([first, second])]
        turns = self.scans.headings[second] - self.scans.headings[first]
        if self.scheme.turned:
            sectors = rng.integers(self.raster.sectors, size=(2, len(numbers)))
            rasters = self.raster.turned(rasters, torch.from_numpy(sectors.ravel()))
            turns = turns + (sectors[0] - sectors[1]) * (2 * np.pi / self.raster.sectors)
        overlap = torch.from_numpy(self.overlaps[numbers]).float()
        return OverlapBatch(rasters, overlap, torch.from_numpy(wrap_angle(turns)).float())


def drawn_pairs(
    scans: TrainingScans, scheme: OverlapScheme, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Numbers of two different scans of one dataset for each pair, (p, 2), each pair once.

    Raises DataError where there is none.
    """
    near = within(scans.points, scheme.radius)
    pairs = []
    for scan in range(len(scans)):
        others = near[scan][near[scan] != scan]
        close = rng.permutation(others)[: scheme.partners - scheme.partners // 2]
        same = np.flatnonzero(scans.dataset == scans.dataset[scan])
        far = rng.permutation(np.setdiff1d(same, [scan, *close]))[: scheme.partners - len(close)]
        pairs += [(scan, partner) for partner in (*close, *far)]
    if not pairs:
        raise DataError(
            f"sampling: none of {len(scans)} training scans has another in its dataset, expected "
            "at least two; use more training scans"
        )
    return np.array(pairs, dtype=np.int64)


def _expect_ranges(raster: Raster) -> RangeNormalRaster:
    if not isinstance(raster, RangeNormalRaster):
        raise ConfigError(
            "sampling: OverlapScheme, expected a method that takes a RangeNormalRaster, whose "
            f"ranges overlap, got a {type(raster).__name__}; choose another sampling or method"
        )
    return raster
