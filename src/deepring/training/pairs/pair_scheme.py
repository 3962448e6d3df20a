"""The pair scheme: as many pairs of one place as of two, or another share (LocNet, RINet).

Source: Yin et al., IV 2018 (HuanYin94/LocNet_caffe); Li et al., RA-L 2022 (lilin-hitcrt/RINet).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.methods.network import NetworkMethod
from deepring.rasters import Raster
from deepring.training.pairs.pair_losses import (
    EXPECTED_HEAD,
    PairDescriptors,
    PairHead,
    PairLoss,
    SoftMatch,
)
from deepring.training.scheme import Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, check_radii, within


class PairBatch(NamedTuple):
    """n pairs: a scan of each, then their partners in the same order."""

    rasters: Tensor
    """(2 n, *raster.shape)."""
    same: Tensor
    """(n,) bool: drawn as a pair of one place."""
    metres: Tensor
    """(n,) float32: distance between the two scans; 10^6 or more between two datasets."""


@dataclass(frozen=True)
class PairScheme(TrainingScheme):
    """Pairs; distances in metres.

    Of the ``pairs`` of a batch the share ``same`` is within ``positive_radius``, the rest beyond
    ``negative_radius``. With None for ``per_epoch``, an epoch has as many batches as the scans
    fill. ``turned`` turns every scan by a random number of sectors of its own. The share ``hidden``
    of the pairs loses one sector of up to ``hidden_width`` degrees, the same in both scans.
    """

    loss_type = PairLoss

    pairs: int = 64
    same: float = 0.5
    per_epoch: int | None = None
    positive_radius: float = 3.0
    negative_radius: float = 3.0
    turned: bool = False
    hidden: float = 0.0
    hidden_width: float = 60.0

    def __post_init__(self) -> None:
        checks.count("sampling.pairs", self.pairs, 2)
        checks.share("sampling.same", self.same)
        if self.per_epoch is not None:
            checks.count("sampling.per_epoch", self.per_epoch)
        check_radii(self.positive_radius, self.negative_radius)
        checks.share("sampling.hidden", self.hidden)
        checks.between("sampling.hidden_width", self.hidden_width, 0, 360, "degrees")

    def training_set(self, scans: TrainingScans, seed: int) -> "PairSet":
        """Batches of the scans. Raises DataError where there is no pair of a kind that counts."""
        return PairSet(scans, self, seed)

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:
        """Raise ConfigError for a loss of a match that the method does not tell, and for scans
        that are to be turned or hidden and cannot be.
        """
        if isinstance(loss, SoftMatch) and not isinstance(method, PairHead):
            raise ConfigError(
                f"loss: SoftMatch does not serve {method.settings.label}, {EXPECTED_HEAD}"
            )
        if self.turned:
            method.raster.sectors  # noqa: B018
        if self.hidden:
            _expect_sectors(method.raster)

    def step(self, method: NetworkMethod, loss: PairLoss, batch: PairBatch) -> Step:
        """Describe both scans of all pairs at once."""
        descriptors = method(batch.rasters)
        first, second = method.vectors(descriptors).chunk(2)
        logits: Tensor | None = None
        if isinstance(method, PairHead):
            logits = method.match_logits(*descriptors.chunk(2))
        return loss(PairDescriptors(first, second, logits, batch.same, batch.metres))


class PairSet(TrainingSet[PairBatch]):
    """Batches of pairs, see `PairBatch`."""

    def __init__(self, scans: TrainingScans, scheme: PairScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.points = scans.points
        self.near = within(self.points, scheme.positive_radius)
        self.around = within(self.points, scheme.negative_radius)
        self.with_near = np.flatnonzero([len(near) > 1 for near in self.near])
        self.with_far = np.flatnonzero([len(around) < len(scans) for around in self.around])
        self.number_same = round(scheme.pairs * scheme.same)
        self._expect_pairs()
        if scheme.hidden:
            _expect_sectors(scans.rasters.raster)
        self.sectors = scans.rasters.raster.sectors if scheme.turned or scheme.hidden else 0

    def _expect_pairs(self) -> None:
        s, number = self.scheme, len(self.scans)
        if self.number_same and not len(self.with_near):
            raise DataError(
                f"sampling.positive_radius: none of {number} training scans has another within "
                f"{s.positive_radius:g} m; raise it, or use more training scans"
            )
        if self.number_same < s.pairs and not len(self.with_far):
            raise DataError(
                f"sampling.negative_radius: none of {number} training scans has another beyond "
                f"{s.negative_radius:g} m; lower it, or enlarge the training region"
            )

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or max(1, len(self.scans) // (2 * self.scheme.pairs))

    def __getitem__(self, index: int) -> PairBatch:
        """Batch ``index``."""
        rng = np.random.default_rng([self.seed, index])
        pairs = self.sample(rng)
        rasters = self.scans.rasters[pairs.T.ravel()]
        if self.scheme.turned:
            sectors = torch.from_numpy(rng.integers(self.sectors, size=len(rasters)))
            rasters = self.scans.rasters.raster.turned(rasters, sectors)
        if self.scheme.hidden:
            rasters = self._hide(rasters, rng)
        same = torch.arange(len(pairs)) < self.number_same
        first, second = self.points[pairs.T]
        metres = torch.from_numpy(np.linalg.norm(first - second, axis=1)).float()
        return PairBatch(rasters, same, metres)

    def sample(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Numbers of two scans for each pair, (pairs, 2); those of one place come first."""
        same, other = self.number_same, self.scheme.pairs - self.number_same
        pairs = [(k, self._partner(k, rng)) for k in _drawn(self.with_near, same, rng)]
        pairs += [(k, self._stranger(k, rng)) for k in _drawn(self.with_far, other, rng)]
        return np.array(pairs, dtype=np.int64)

    def _partner(self, scan: int, rng: np.random.Generator) -> int:
        near = self.near[scan]
        return int(rng.choice(near[near != scan]))

    def _stranger(self, scan: int, rng: np.random.Generator) -> int:
        beyond = np.ones(len(self.scans), dtype=np.bool_)
        beyond[self.around[scan]] = False
        return int(rng.choice(np.flatnonzero(beyond)))

    def _hide(self, rasters: Tensor, rng: np.random.Generator) -> Tensor:
        """Scans (2 n, ..., θ, channel) of which some pairs lose a sector, set to zero."""
        n = len(rasters) // 2
        width = rng.uniform(0, self.scheme.hidden_width / 360, n) * self.sectors
        width *= rng.random(n) < self.scheme.hidden
        start = rng.integers(self.sectors, size=n)
        after = (np.arange(self.sectors) - start[:, None]) % self.sectors
        seen = torch.from_numpy(np.tile(after >= np.round(width)[:, None], (2, 1)))
        shape = [2 * n, *[1] * (rasters.dim() - 3), self.sectors, 1]
        return rasters * seen.view(shape).to(rasters.dtype)


def _drawn(scans: NDArray[np.int64], number: int, rng: np.random.Generator) -> list[int]:
    """So many of the scans, each as seldom more than once as their number allows."""
    rounds = -(-number // max(1, len(scans)))
    drawn = [rng.permutation(scans) for _ in range(rounds)]
    return [] if not drawn else np.concatenate(drawn)[:number].tolist()


def _expect_sectors(raster: Raster) -> None:
    """Raise ConfigError unless azimuth is on the axis before the last."""
    if len(raster.axes) < 2 or raster.axes[-2] != "theta":
        raise ConfigError(
            f"sampling.hidden: the method takes a {type(raster).__name__}, which has no axis of "
            "azimuth before its last, expected 0; set it so"
        )
