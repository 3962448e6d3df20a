"""The batch-hard scheme, which compares all scans of a batch with each other (EgoNN).

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

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.methods.method import describe_all
from deepring.methods.network import NetworkMethod
from deepring.training.scheme import Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, check_radii, within
from deepring.training.triplets import TRIPLETS, TripletMining, batch_accuracy, squared_distances


class ScanBatch(NamedTuple):
    """b scans, masks of pairs at the same place and at different places, and how scans lie."""

    rasters: Tensor
    """(b, *raster.shape)."""
    positives: Tensor
    """(b, b) bool: pairs at the same place, without the diagonal."""
    negatives: Tensor
    """(b, b) bool: pairs at different places."""
    orientations: Tensor
    """(b,) float64 sectors: scans of one place differ by a turn of the difference, see
    `BatchHardScheme`; zeros where scans are not turned."""


class ScanBatchLoss(nn.Module, ABC):
    """Base class of losses of a whole batch."""

    @abstractmethod
    def forward(self, vectors: Tensor, positives: Tensor, negatives: Tensor) -> Step:
        """Loss of vectors (b, d) and the masks (b, b) of `ScanBatch`."""

    def of_batch(self, vectors: Tensor, descriptors: Tensor, batch: ScanBatch) -> Step:  # noqa: ARG002
        """Loss of a batch; losses that need the descriptors (b, ...) or turns override this."""
        return self(vectors, batch.positives, batch.negatives)

    def expect(self, method: NetworkMethod, *, turned: bool) -> None:
        """Raise ConfigError for a method or a sampling that does not serve; takes any here."""


class BatchHardTriplet(ScanBatchLoss):
    """[margin + d(a, p) - d(a, n)]₊ of triplets of a batch, the mean over those that are not zero.

    d is the Euclidean distance. The mean is pytorch-metric-learning's reducer, which EgoNN uses
    (jac99/Egonn, models/loss.py). ``mining`` chooses the triplets:

    - 'hardest': the farthest positive and the nearest negative of each scan, as in EgoNN. With
      random initial weights they may collapse all descriptors into one point.
    - 'semihard': for each pair of one place, the nearest negative that is farther than the
      positive, or the farthest negative where none is (Schroff et al., "FaceNet", CVPR 2015,
      Sec. 3.2).
    - 'all': every triplet of the batch.

    The first ``warm_up`` batches take all triplets whatever ``mining`` says, so that the hardest
    ones begin from descriptors that already differ. Checkpoints store the batches counted.

    Args:
        margin: by which another place has to be farther than the same one
    """

    def __init__(
        self, margin: float = 0.2, mining: TripletMining = "hardest", warm_up: int = 0
    ) -> None:
        super().__init__()
        self.margin = checks.positive("loss.margin", margin)
        self.mining = checks.one_of("loss.mining", mining, TripletMining)
        self.warm_up = checks.count("loss.warm_up", warm_up, 0)
        self.batches: Tensor
        self.register_buffer("batches", torch.zeros((), dtype=torch.int64))

    def forward(self, vectors: Tensor, positives: Tensor, negatives: Tensor) -> Step:
        """See `ScanBatchLoss`. Scans without a positive or a negative do not count.

        ``parts`` has the share of ``active`` triplets, those that are not zero.
        """
        # The root's gradient is infinite at 0.
        distance = (squared_distances(vectors) + 1e-12).sqrt()
        mining = self.mining if self.batches >= self.warm_up else "all"
        if self.training:
            self.batches += 1
        violation = (self.margin + TRIPLETS[mining](distance, positives, negatives)).clamp_min(0)
        active = violation > 0
        loss = violation.sum() / active.sum().clamp_min(1)
        ratio = active.float().mean() if len(active) else vectors.new_zeros(())
        return Step(loss, batch_accuracy(distance, positives, negatives), {"active": ratio})


@dataclass(frozen=True)
class BatchHardScheme(TrainingScheme):
    """Batches of pairs; distances in metres. Defaults are EgoNN's.

    A batch is ``size`` scans in pairs at the same place. Scans within ``positive_radius`` of each
    other are at the same place, those beyond ``negative_radius`` at different places. After an
    epoch with a share of active triplets below ``expand_below``, batches grow by the factor
    ``expand_by``, up to ``limit``. ``turned`` turns each scan by a random number of sectors; scans
    of one place then differ by the turn (scan i is scan j turned by ``orientations[i] -
    orientations[j]`` sectors), which their headings tell. With None for ``per_epoch``, an epoch has
    as many batches of the first size as the scans fill.

    From epoch ``hard_from`` on (counted from 0), a share ``hard`` of the pairs are hard negatives
    of the pair before: the most similar of ``candidates`` random scans at other places, by
    descriptors that the network computes before each epoch.
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
    hard: float = 0.0
    hard_from: int = 3
    candidates: int = 100

    def __post_init__(self) -> None:
        checks.share("sampling.hard", self.hard)
        checks.count("sampling.hard_from", self.hard_from, 0)
        checks.count("sampling.candidates", self.candidates)
        if checks.count("sampling.size", self.size, 4) % 2:
            raise ConfigError(
                f"sampling.size: {self.size}, expected an even number, since a batch is pairs"
            )
        checks.count("sampling.limit", self.limit, self.size)
        checks.share("sampling.expand_below", self.expand_below)
        checks.at_least("sampling.expand_by", self.expand_by, 1)
        if self.per_epoch is not None:
            checks.count("sampling.per_epoch", self.per_epoch)
        check_radii(self.positive_radius, self.negative_radius)

    def training_set(self, scans: TrainingScans, seed: int) -> "ScanBatchSet":
        """Batches of the scans. Raises DataError for too few pairs."""
        return ScanBatchSet(scans, self, seed)

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:
        """Raise ConfigError for scans that cannot be turned, or a loss that cannot serve."""
        if self.turned:
            method.raster.sectors  # noqa: B018
        assert isinstance(loss, ScanBatchLoss)
        loss.expect(method, turned=self.turned)

    def step(self, method: NetworkMethod, loss: ScanBatchLoss, batch: ScanBatch) -> Step:
        """Describe the batch and compare all its scans with each other."""
        descriptors = method(batch.rasters)
        return loss.of_batch(method.vectors(descriptors), descriptors, batch)


class ScanBatchSet(TrainingSet[ScanBatch]):
    """Batches of pairs that grow between epochs, see `ScanBatch`."""

    def __init__(self, scans: TrainingScans, scheme: BatchHardScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.size = scheme.size
        self.sectors = scans.rasters.raster.sectors if scheme.turned else 0
        self.points = scans.points
        self.near = within(self.points, scheme.positive_radius)
        self.vectors: Tensor | None = None
        self.anchors = np.array(
            [k for k, near in enumerate(self.near) if len(near) > 1], dtype=np.int64
        )
        if 2 * len(self.anchors) < scheme.size:
            raise DataError(
                f"sampling.size: {scheme.size} scans in pairs, but only {len(self.anchors)} of "
                f"{len(scans)} training scans have another within {scheme.positive_radius:g} m; "
                "raise sampling.positive_radius, lower sampling.size, or use more training scans"
            )

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or max(1, len(self.scans) // self.scheme.size)

    def before_epoch(self, epoch: int, method: NetworkMethod) -> None:
        """Describe all training scans with the current weights, to find hard negatives."""
        if self.scheme.hard and epoch >= self.scheme.hard_from:
            descriptors = describe_all(method, self.scans.rasters)
            self.vectors = method.vectors(descriptors).float().cpu()

    def after_epoch(self, parts: Mapping[str, float]) -> None:
        """Grow the batches if the share of ``active`` triplets was small."""
        if parts.get("active", 1.0) < self.scheme.expand_below:
            self.expand()

    def state_dict(self) -> dict[str, Any]:
        """The current batch size."""
        return {"size": self.size}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the batch size of a resumed run."""
        self.size = state["size"]

    def expand(self) -> None:
        """Grow the batches by one step, to an even number of scans."""
        s = self.scheme
        self.size = min(int(self.size * s.expand_by), s.limit) // 2 * 2

    def __getitem__(self, index: int) -> ScanBatch:
        """Batch ``index`` at the current size."""
        rng = np.random.default_rng([self.seed, index])
        scans = self.sample(rng)
        rasters = self.scans.rasters[scans]
        orientations = torch.zeros(len(scans), dtype=torch.float64)
        if self.scheme.turned:
            sectors = torch.from_numpy(rng.integers(self.sectors, size=len(scans)))
            rasters = self.scans.rasters.raster.turned(rasters, sectors)
            # A robot turned by +h sees the scene turned by -h.
            headings = torch.from_numpy(self.scans.headings[scans])
            orientations = sectors - headings * (self.sectors / (2 * np.pi))
        points = self.points[scans]
        distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
        positives = (distance <= self.scheme.positive_radius) & ~np.eye(len(scans), dtype=bool)
        negatives = distance > self.scheme.negative_radius
        masks = torch.from_numpy(positives), torch.from_numpy(negatives)
        return ScanBatch(rasters, *masks, orientations)

    def sample(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Distinct scan numbers of a batch: anchors, each with a partner of its place."""
        scans: dict[int, None] = {}
        anchors = iter(rng.permutation(self.anchors).tolist())
        last: int | None = None
        while len(scans) < self.size:
            anchor = None if last is None else self._alike(last, rng)
            last = None
            if anchor is None or anchor in scans:
                anchor = next(anchors, None)
            if anchor is None:
                break
            free = [k for k in self.near[anchor].tolist() if k != anchor and k not in scans]
            if anchor in scans or not free:
                continue
            scans |= {anchor: None, int(rng.choice(free)): None}
            last = anchor
        return np.fromiter(scans, dtype=np.int64)

    def _alike(self, scan: int, rng: np.random.Generator) -> int | None:
        """A hard negative of a scan; None where chance wants none, or none is known."""
        if self.vectors is None or rng.random() >= self.scheme.hard:
            return None
        pool = rng.choice(self.anchors, min(self.scheme.candidates, len(self.anchors)), False)
        apart = np.linalg.norm(self.points[pool] - self.points[scan], axis=1)
        pool = pool[apart > self.scheme.negative_radius]
        if not len(pool):
            return None
        distances = torch.cdist(self.vectors[scan][None], self.vectors[pool])[0]
        return int(pool[int(distances.argmin())])
