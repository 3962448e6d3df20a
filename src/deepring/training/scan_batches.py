"""Batches in which every scan is compared with every other (EgoNN's batch-hard training).

Source: Komorowski et al., RA-L 2021, Sec. III-C; jac99/Egonn (datasets/samplers.py).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from deepring.errors import DeepringError
from deepring.training.training_scans import TrainingScans, check_apart, within


class ScanBatch(NamedTuple):
    """b scans, and which of them show the same and which different places."""

    rasters: Tensor
    """(b, *raster.shape)."""
    same: Tensor
    """(b, b) bool, the diagonal False."""
    different: Tensor
    """(b, b) bool."""


@dataclass(frozen=True)
class ScanBatchSettings:
    """How batches are drawn; distances in metres. Defaults are EgoNN's.

    A batch is ``size`` scans, pairs of one place. After an epoch in which less than the share
    ``expand_below`` of the triplets was active, batches grow by ``expand_by``, up to ``limit``.
    ``turned`` turns each scan by a random number of sectors. None for ``per_epoch`` takes as many
    batches of the first size as the scans fill.
    """

    size: int = 32
    limit: int = 128
    expand_below: float = 0.7
    expand_by: float = 1.4
    per_epoch: int | None = None
    same: float = 2.0
    different: float = 10.0
    turned: bool = True

    def __post_init__(self) -> None:
        if self.size < 4 or self.size % 2 or self.limit < self.size:
            raise DeepringError(
                f"drawing.size: {self.size}, drawing.limit: {self.limit}; expected an even size of "
                "at least 4, and a limit that is no smaller"
            )
        if self.per_epoch is not None and self.per_epoch < 1:
            raise DeepringError(f"drawing.per_epoch: {self.per_epoch}, expected at least 1")
        if not (0 <= self.expand_below <= 1 and self.expand_by >= 1):
            raise DeepringError(
                f"drawing.expand_below: {self.expand_below}, drawing.expand_by: {self.expand_by}; "
                "expected a share and a factor of at least 1"
            )
        check_apart("drawing", self.same, self.different)

    def training_set(self, pool: TrainingScans, seed: int) -> "ScanBatchSet":
        """Batches of a pool. Raises DeepringError where it holds too few pairs."""
        return ScanBatchSet(pool, self, seed)


class ScanBatchSet(Dataset[ScanBatch]):
    """Batch number i, the same in every process and for any number of workers."""

    def __init__(self, pool: TrainingScans, settings: ScanBatchSettings, seed: int) -> None:
        self.pool, self.settings, self.seed = pool, settings, seed
        self.size = settings.size
        self.sectors = pool.rasters.raster.sectors if settings.turned else 0
        self.points = pool.points
        self.near = within(self.points, settings.same)
        self.anchors = np.array(
            [k for k, near in enumerate(self.near) if len(near) > 1], dtype=np.int64
        )
        if 2 * len(self.anchors) < settings.size:
            raise DeepringError(
                f"drawing.size: {settings.size} scans in pairs, but only {len(self.anchors)} of "
                f"{len(pool)} training scans have another within {settings.same:g} m; raise "
                "drawing.same, lower drawing.size or data.spacing.train"
            )

    def __len__(self) -> int:
        """Batches in an epoch."""
        return self.settings.per_epoch or max(1, len(self.pool) // self.settings.size)

    def expand(self) -> None:
        """Grow the batch."""
        s = self.settings
        self.size = min(int(self.size * s.expand_by), s.limit) // 2 * 2

    def __getitem__(self, index: int) -> ScanBatch:
        """Draw batch ``index``, of all epochs counted through, at the present size."""
        rng = np.random.default_rng([self.seed, index])
        scans = self.draw(rng)
        rasters = self.pool.rasters[scans]
        if self.settings.turned:
            sectors = torch.from_numpy(rng.integers(self.sectors, size=len(scans)))
            rasters = self.pool.rasters.raster.turned(rasters, sectors)
        points = self.points[scans]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        same = (apart <= self.settings.same) & ~np.eye(len(scans), dtype=bool)
        different = apart > self.settings.different
        return ScanBatch(rasters, torch.from_numpy(same), torch.from_numpy(different))

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
