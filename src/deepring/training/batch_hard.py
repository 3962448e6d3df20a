"""The batch-hard scheme: every scan of a batch is compared with every other (EgoNN).

Source: Komorowski et al., RA-L 2021, Sec. III-C; jac99/Egonn (datasets/samplers.py).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring.checks import at_least, count, one_of, positive, share
from deepring.errors import ConfigError, DataError
from deepring.methods.network import NetworkMethod
from deepring.training.scheme import Mining, Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, check_radii, within


class ScanBatch(NamedTuple):
    """b scans, and which of them show the same and which different places."""

    rasters: Tensor
    """(b, *raster.shape)."""
    positives: Tensor
    """(b, b) bool: of the same place; the diagonal is False."""
    negatives: Tensor
    """(b, b) bool: of different places."""


class ScanBatchLoss(nn.Module, ABC):
    """Base of the losses of a whole batch."""

    @abstractmethod
    def forward(self, vectors: Tensor, positives: Tensor, negatives: Tensor) -> Step:
        """Loss of vectors (b, d) and the masks (b, b) of `ScanBatch`."""


class BatchHardTriplet(ScanBatchLoss):
    """[margin + max d(a, p) - min d(a, n)]₊, the hardest positive and negative of each scan.

    d is the Euclidean distance. The mean is over triplets that are not zero, as in
    pytorch-metric-learning's reducer, which EgoNN takes (jac99/Egonn, models/loss.py). From
    random weights hardest triplets may pull all descriptors into one point and hold them there;
    ``mining='all'`` takes all triplets of the batch.
    """

    def __init__(self, margin: float = 0.2, mining: Mining = "hardest") -> None:
        super().__init__()
        self.margin = positive("loss.margin", margin)
        self.mining = one_of("loss.mining", mining, Mining)

    def forward(self, vectors: Tensor, positives: Tensor, negatives: Tensor) -> Step:
        """See `ScanBatchLoss`; scans without a positive or a negative do not count.

        ``parts`` tell the share of ``active`` triplets, those that are not zero.
        """
        # The root's gradient is infinite at 0.
        apart = ((vectors[:, None] - vectors[None]).square().sum(dim=-1) + 1e-12).sqrt()
        usable = positives.any(dim=1) & negatives.any(dim=1)
        own = apart.masked_fill(~positives, -torch.inf).amax(dim=1)[usable]
        wrong = apart.masked_fill(~negatives, torch.inf).amin(dim=1)[usable]
        violation = self.margin + own - wrong
        if self.mining == "all":
            triplets = positives[:, :, None] & negatives[:, None, :]
            violation = (self.margin + apart[:, :, None] - apart[:, None, :])[triplets]
        violation = violation.clamp_min(0)
        active = violation > 0
        loss = violation.sum() / active.sum().clamp_min(1)
        ratio = active.float().mean() if len(active) else vectors.new_zeros(())
        accuracy = (own < wrong).float().mean() if len(own) else vectors.new_zeros(())
        return Step(loss, accuracy.detach(), {"active": ratio})


@dataclass(frozen=True)
class BatchHardScheme(TrainingScheme):
    """Batches of pairs; distances in metres. Defaults are EgoNN's.

    A batch is ``size`` scans, pairs of one place: scans within ``positive_radius`` of each other
    are of one place, those beyond ``negative_radius`` of different places. After an epoch in
    which less than the share ``expand_below`` of the triplets was active, batches grow by
    ``expand_by``, up to ``limit``. ``turned`` turns each scan by a random number of sectors. None
    for ``per_epoch`` takes as many batches of the first size as the scans fill.
    """

    loss_type = ScanBatchLoss

    size: int = 32
    limit: int = 128
    expand_below: float = 0.7
    expand_by: float = 1.4
    per_epoch: int | None = None
    positive_radius: float = 2.0
    negative_radius: float = 10.0
    turned: bool = True

    def __post_init__(self) -> None:
        if count("sampling.size", self.size, 4) % 2:
            raise ConfigError(f"sampling.size: {self.size}, expected an even number: pairs")
        count("sampling.limit", self.limit, self.size)
        share("sampling.expand_below", self.expand_below)
        at_least("sampling.expand_by", self.expand_by, 1)
        if self.per_epoch is not None:
            count("sampling.per_epoch", self.per_epoch)
        check_radii(self.positive_radius, self.negative_radius)

    def training_set(self, scans: TrainingScans, seed: int) -> "ScanBatchSet":
        """Batches of the scans. Raises DataError where they hold too few pairs."""
        return ScanBatchSet(scans, self, seed)

    def step(self, method: NetworkMethod, loss: ScanBatchLoss, batch: ScanBatch) -> Step:
        """Describe the batch and compare all its scans."""
        return loss(method.vectors(method(batch.rasters)), batch.positives, batch.negatives)


class ScanBatchSet(TrainingSet[ScanBatch]):
    """Batches of pairs, which grow from epoch to epoch, see `ScanBatch`."""

    def __init__(self, scans: TrainingScans, scheme: BatchHardScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.size = scheme.size
        self.sectors = scans.rasters.raster.sectors if scheme.turned else 0
        self.points = scans.points
        self.near = within(self.points, scheme.positive_radius)
        self.anchors = np.array(
            [k for k, near in enumerate(self.near) if len(near) > 1], dtype=np.int64
        )
        if 2 * len(self.anchors) < scheme.size:
            raise DataError(
                f"sampling.size: {scheme.size} scans in pairs, but only {len(self.anchors)} of "
                f"{len(scans)} training scans have another within {scheme.positive_radius:g} m; "
                "raise sampling.positive_radius, lower sampling.size or data.spacing.train"
            )

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or max(1, len(self.scans) // self.scheme.size)

    def after_epoch(self, parts: Mapping[str, float]) -> None:
        """Grow the batches where the share of ``active`` triplets was small."""
        if parts.get("active", 1.0) < self.scheme.expand_below:
            self.expand()

    def state_dict(self) -> dict[str, Any]:
        """The present size."""
        return {"size": self.size}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up the size of the run that goes on."""
        self.size = state["size"]

    def expand(self) -> None:
        """Grow the batch by one step, to an even number of scans."""
        s = self.scheme
        self.size = min(int(self.size * s.expand_by), s.limit) // 2 * 2

    def __getitem__(self, index: int) -> ScanBatch:
        """Draw batch ``index`` at the present size."""
        rng = np.random.default_rng([self.seed, index])
        scans = self.draw(rng)
        rasters = self.scans.rasters[scans]
        if self.scheme.turned:
            sectors = torch.from_numpy(rng.integers(self.sectors, size=len(scans)))
            rasters = self.scans.rasters.raster.turned(rasters, sectors)
        points = self.points[scans]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        positives = (apart <= self.scheme.positive_radius) & ~np.eye(len(scans), dtype=bool)
        negatives = apart > self.scheme.negative_radius
        return ScanBatch(rasters, torch.from_numpy(positives), torch.from_numpy(negatives))

    def draw(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Numbers of the scans of a batch, none twice: anchors in random order, and a partner."""
        taken: dict[int, None] = {}
        for anchor in rng.permutation(self.anchors):
            if int(anchor) in taken:
                continue
            free = [k for k in self.near[anchor].tolist() if k != anchor and k not in taken]
            if not free:
                continue
            taken |= {int(anchor): None, int(rng.choice(free)): None}
            if len(taken) >= self.size:
                break
        return np.fromiter(taken, dtype=np.int64)
