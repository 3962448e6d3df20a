"""The batches of each process of a run, per epoch."""

import math
from collections.abc import Iterator

from torch.utils.data import Sampler


class BatchOrder(Sampler[int]):
    """Numbers of an epoch's batches; each process of a distributed run has its own."""

    def __init__(self, per_epoch: int, rank: int = 0, world_size: int = 1) -> None:
        self.per_epoch, self.rank, self.world_size = per_epoch, rank, world_size
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Called by Lightning at the start of each epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        return math.ceil(self.per_epoch / self.world_size)

    def __iter__(self) -> Iterator[int]:
        first = self.epoch * len(self) * self.world_size
        for k in range(len(self)):
            yield first + k * self.world_size + self.rank
