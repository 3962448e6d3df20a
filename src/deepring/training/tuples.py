"""Tuples to train on: a query, scans of its place, scans of other places (PointNetVLAD, DiSCO).

Source: Uy and Lee, CVPR 2018 (mikacuy/pointnetvlad); Xu et al., RA-L 2021
(MaverickPeter/DiSCO-pytorch).
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


class TupleBatch(NamedTuple):
    """t tuples; each row is a query, then its positives, its negatives, and one more negative."""

    rasters: Tensor
    """(t, 1 + positives + negatives + 1, *raster.shape)."""
    positives: int
    turn: Tensor
    """(t,) int64: sectors by which the query is turned against its positives; 0 without turns."""


@dataclass(frozen=True)
class TupleSettings:
    """How tuples are drawn; distances in metres. Defaults are PointNetVLAD's.

    Queries come in random order, none twice in an epoch; None for ``per_epoch`` takes all of them.
    ``hard`` of the negatives are the most alike among ``sampled`` random ones, as the network saw
    them when it last described the training scans, which it does before each epoch from
    ``hard_from`` on (counted from 0); until then, and with ``hard`` 0, all are random. The last
    negative is of a place that is none of the tuple's others. ``turned`` aligns the positives
    with the query's heading and turns the query by a random number of sectors (DiSCO).
    """

    per_batch: int = 2
    positives: int = 2
    negatives: int = 18
    per_epoch: int | None = None
    same: float = 10.0
    different: float = 50.0
    hard: int = 10
    sampled: int = 4000
    hard_from: int = 6
    turned: bool = False

    def __post_init__(self) -> None:
        for name in ("per_batch", "positives", "negatives", "per_epoch", "sampled"):
            if getattr(self, name) is not None and getattr(self, name) < 1:
                raise DeepringError(f"drawing.{name}: {getattr(self, name)}, expected at least 1")
        if not 0 <= self.hard <= self.negatives:
            raise DeepringError(
                f"drawing.hard: {self.hard}, expected 0 to drawing.negatives={self.negatives}"
            )
        check_apart("drawing", self.same, self.different)

    def training_set(self, pool: TrainingScans, seed: int) -> "TupleSet":
        """Tuples of a pool. Raises DeepringError where no scan has enough around it."""
        return TupleSet(pool, self, seed)


class TupleSet(Dataset[TupleBatch]):
    """Batch number i, the same in every process and for any number of workers."""

    def __init__(self, pool: TrainingScans, settings: TupleSettings, seed: int) -> None:
        self.pool, self.settings, self.seed = pool, settings, seed
        self.sectors = pool.rasters.raster.sectors if settings.turned else 0
        self.near = within(pool.points, settings.same)
        self.around = within(pool.points, settings.different)
        self.queries = np.array(
            [
                k
                for k in range(len(pool))
                if len(self.near[k]) > settings.positives
                and len(pool) - len(self.around[k]) > settings.negatives
            ],
            dtype=np.int64,
        )
        self.vectors: Tensor | None = None
        if not len(self.queries):
            raise DeepringError(
                f"drawing: none of {len(pool)} training scans has {settings.positives} others "
                f"within {settings.same:g} m and more than {settings.negatives} beyond "
                f"{settings.different:g} m; lower drawing.positives or drawing.negatives, change "
                "drawing.same or drawing.different, or enlarge data.regions.train"
            )
        self[0]  # fail here, not in a worker

    def __len__(self) -> int:
        """Batches in an epoch."""
        return self.settings.per_epoch or -(-len(self.queries) // self.settings.per_batch)

    def learn(self, vectors: Tensor) -> None:
        """Take descriptors (n, d) of all scans, by which hard negatives are found."""
        self.vectors = vectors

    def __getitem__(self, index: int) -> TupleBatch:
        """Draw batch ``index``, of all epochs counted through."""
        rng = np.random.default_rng([self.seed, index])
        epoch, number = divmod(index, len(self))
        order = np.random.default_rng([self.seed, epoch, 1]).permutation(self.queries)
        first = number * self.settings.per_batch
        queries = order.take(range(first, first + self.settings.per_batch), mode="wrap")
        scans = np.stack([self.draw(int(query), rng) for query in queries])
        rasters = self.pool.rasters[scans]
        turn = torch.zeros(len(scans), dtype=torch.int64)
        if self.settings.turned:
            turn = torch.from_numpy(rng.integers(self.sectors, size=len(scans)))
            rasters = self._turned(rasters, scans, turn)
        return TupleBatch(rasters, self.settings.positives, turn)

    def draw(self, query: int, rng: np.random.Generator, tries: int = 20) -> NDArray[np.int64]:
        """Numbers of the scans of one tuple, in the order of `TupleBatch`.

        The last negative is chosen before the others, which keep away from it. Raises
        DeepringError where the pool is too small for both.
        """
        s = self.settings
        near = self.near[query]
        positives = rng.choice(near[near != query], s.positives, replace=False)
        far = self._beyond(query)
        for other in rng.permutation(far)[:tries]:
            candidates = np.intersect1d(far, self._beyond(int(other)), assume_unique=True)
            if len(candidates) >= s.negatives:
                negatives = self._negatives(query, candidates, rng)
                return np.concatenate([[query], positives, negatives, [other]])
        raise DeepringError(
            f"drawing.negatives: {s.negatives} scans that are all beyond {s.different:g} m of the "
            f"query and of one more negative are not to be had among {len(self.pool)} training "
            "scans; lower drawing.negatives or drawing.different, or enlarge data.regions.train"
        )

    def _beyond(self, scan: int) -> NDArray[np.int64]:
        """The scans of other places than this one's."""
        everything = np.ones(len(self.pool), dtype=np.bool_)
        everything[self.around[scan]] = False
        return np.flatnonzero(everything)

    def _negatives(
        self, query: int, candidates: NDArray[np.int64], rng: np.random.Generator
    ) -> NDArray[np.int64]:
        s = self.settings
        shuffled = rng.permutation(candidates)
        if self.vectors is None or not s.hard:
            return shuffled[: s.negatives]
        sampled = shuffled[: s.sampled]
        apart = torch.cdist(self.vectors[query][None], self.vectors[sampled])[0]
        hard = sampled[apart.argsort(stable=True)[: s.hard].numpy()]
        rest = shuffled[~np.isin(shuffled, hard)]
        return np.concatenate([hard, rest])[: s.negatives]

    def _turned(self, rasters: Tensor, scans: NDArray[np.int64], turn: Tensor) -> Tensor:
        """Positives aligned with their query's heading, the query turned; negatives as they are."""
        raster, step = self.pool.rasters.raster, 2 * np.pi / self.sectors
        headings = self.pool.headings[scans]  # (t, k)
        # Seen from the query's heading the points of a positive are turned by h_p - h_q.
        apart = np.round((headings - headings[:, :1]) / step).astype(np.int64)
        apart[:, 1 + self.settings.positives :] = 0
        sectors = torch.from_numpy(apart)
        sectors[:, 0] = turn
        flat = raster.turned(rasters.flatten(0, 1), sectors.flatten())
        return flat.view_as(rasters)
