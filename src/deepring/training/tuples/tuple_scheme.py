"""The tuple scheme: a query, positives and negatives (PointNetVLAD, DiSCO).

Source: Uy and Lee, CVPR 2018 (mikacuy/pointnetvlad); Xu et al., RA-L 2021
(MaverickPeter/DiSCO-pytorch).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring.checks import count
from deepring.errors import ConfigError, DataError
from deepring.methods.method import describe_all
from deepring.methods.network import NetworkMethod
from deepring.training.scheme import Step, TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans, check_radii, within
from deepring.training.tuples.tuple_losses import TupleDescriptors, TupleLoss


class TupleBatch(NamedTuple):
    """t tuples: a query, its positives, its negatives, and one more negative per row."""

    rasters: Tensor
    """(t, 1 + positives + negatives + 1, *raster.shape)."""
    positives: int
    """Positives per tuple."""
    turn: Tensor
    """(t,) int64: turn of the query relative to its positives, sectors; 0 without turns."""


@dataclass(frozen=True)
class TupleScheme(TrainingScheme):
    """Tuples; distances in metres. Defaults are PointNetVLAD's.

    Queries come in random order, each at most once per epoch; with None for ``per_epoch``, an epoch
    has all of them. Positives are within ``positive_radius`` of the query, negatives beyond
    ``negative_radius``. ``hard`` of the negatives are the most similar among ``candidates`` random
    ones, by descriptors that the network computes before each epoch from ``hard_from`` on (counted
    from 0); earlier, and with ``hard`` 0, all are random. The last negative is beyond
    ``negative_radius`` of the query and of all other negatives. ``turned`` aligns the positives
    with the query's heading and turns the query by a random number of sectors (DiSCO).
    """

    loss_type = TupleLoss

    per_batch: int = 2  # tuples of a batch
    positives: int = 2  # of a tuple
    negatives: int = 18  # of a tuple
    per_epoch: int | None = None
    positive_radius: float = 10.0
    negative_radius: float = 50.0
    hard: int = 10
    candidates: int = 4000
    hard_from: int = 6
    turned: bool = False

    def __post_init__(self) -> None:
        for name in ("per_batch", "positives", "negatives", "candidates"):
            count(f"sampling.{name}", getattr(self, name))
        for name in ("hard", "hard_from"):
            count(f"sampling.{name}", getattr(self, name), 0)
        if self.per_epoch is not None:
            count("sampling.per_epoch", self.per_epoch)
        if self.hard > self.negatives:
            raise ConfigError(
                f"sampling.hard: {self.hard}, expected 0 to sampling.negatives={self.negatives}"
            )
        check_radii(self.positive_radius, self.negative_radius)

    def training_set(self, scans: TrainingScans, seed: int) -> "TupleSet":
        """Tuples of the scans. Raises DataError if no scan has enough positives and negatives."""
        return TupleSet(scans, self, seed)

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:
        """Raise ConfigError for scans that cannot be turned, or a loss that cannot serve."""
        if self.turned:
            method.raster.sectors  # noqa: B018
        assert isinstance(loss, TupleLoss)
        loss.expect(method, turned=self.turned)

    def step(self, method: NetworkMethod, loss: TupleLoss, batch: TupleBatch) -> Step:
        """Describe all scans of the tuples at once."""
        shape = batch.rasters.shape[:2]
        descriptors = method(batch.rasters.flatten(0, 1))
        vectors = method.vectors(descriptors).view(*shape, -1)
        descriptors = descriptors.view(*shape, *descriptors.shape[1:])
        return loss(TupleDescriptors(vectors, descriptors, batch.positives, batch.turn))


class TupleSet(TrainingSet[TupleBatch]):
    """Batches of tuples, see `TupleBatch`."""

    def __init__(self, scans: TrainingScans, scheme: TupleScheme, seed: int) -> None:
        self.scans, self.scheme, self.seed = scans, scheme, seed
        self.sectors = scans.rasters.raster.sectors if scheme.turned else 0
        self.near = within(scans.points, scheme.positive_radius)
        self.around = within(scans.points, scheme.negative_radius)
        self.queries = np.array(
            [
                k
                for k in range(len(scans))
                if len(self.near[k]) > scheme.positives
                and len(scans) - len(self.around[k]) > scheme.negatives
            ],
            dtype=np.int64,
        )
        self.vectors: Tensor | None = None
        if not len(self.queries):
            raise DataError(
                f"sampling: none of {len(scans)} training scans has {scheme.positives} other scans "
                f"within {scheme.positive_radius:g} m and more than {scheme.negatives} beyond "
                f"{scheme.negative_radius:g} m; lower sampling.positives or sampling.negatives, "
                "change sampling.positive_radius or sampling.negative_radius, or enlarge "
                "the training region"
            )
        self[0]  # fails here rather than in a worker

    def __len__(self) -> int:
        """Batches per epoch."""
        return self.scheme.per_epoch or -(-len(self.queries) // self.scheme.per_batch)

    def before_epoch(self, epoch: int, method: NetworkMethod) -> None:
        """Describe all training scans with the current weights, to find hard negatives."""
        if self.scheme.hard and epoch >= self.scheme.hard_from:
            descriptors = describe_all(method, self.scans.rasters)
            self.vectors = method.vectors(descriptors).float().cpu()

    def __getitem__(self, index: int) -> TupleBatch:
        """Batch ``index``."""
        rng = np.random.default_rng([self.seed, index])
        epoch, number = divmod(index, len(self))
        order = np.random.default_rng([self.seed, epoch, 1]).permutation(self.queries)
        first = number * self.scheme.per_batch
        queries = order.take(range(first, first + self.scheme.per_batch), mode="wrap")
        scans = np.stack([self.sample(int(query), rng) for query in queries])
        rasters = self.scans.rasters[scans]
        turn = torch.zeros(len(scans), dtype=torch.int64)
        if self.scheme.turned:
            turn = torch.from_numpy(rng.integers(self.sectors, size=len(scans)))
            rasters = self._turn(rasters, scans, turn)
        return TupleBatch(rasters, self.scheme.positives, turn)

    def sample(self, query: int, rng: np.random.Generator, tries: int = 20) -> NDArray[np.int64]:
        """Numbers of the scans of one tuple, in the order of `TupleBatch`.

        The last negative is sampled first, and the others beyond its ``negative_radius``. Raises
        DataError for too few scans.
        """
        s = self.scheme
        near = self.near[query]
        positives = rng.choice(near[near != query], s.positives, replace=False)
        far = self._beyond(query)
        for last in rng.permutation(far)[:tries]:
            candidates = np.intersect1d(far, self._beyond(int(last)), assume_unique=True)
            if len(candidates) >= s.negatives:
                negatives = self._negatives(query, candidates, rng)
                return np.concatenate([[query], positives, negatives, [last]])
        raise DataError(
            f"sampling.negatives: no {s.negatives} of {len(self.scans)} training scans are all "
            f"beyond {s.negative_radius:g} m of the query and of one more negative; lower "
            "sampling.negatives or sampling.negative_radius, or enlarge the training region"
        )

    def _beyond(self, scan: int) -> NDArray[np.int64]:
        """Numbers of the scans beyond ``negative_radius`` of a scan."""
        mask = np.ones(len(self.scans), dtype=np.bool_)
        mask[self.around[scan]] = False
        return np.flatnonzero(mask)

    def _negatives(
        self, query: int, candidates: NDArray[np.int64], rng: np.random.Generator
    ) -> NDArray[np.int64]:
        s = self.scheme
        shuffled = rng.permutation(candidates)
        if self.vectors is None or not s.hard:
            return shuffled[: s.negatives]
        pool = shuffled[: s.candidates]
        distances = torch.cdist(self.vectors[query][None], self.vectors[pool])[0]
        hard = pool[distances.argsort(stable=True)[: s.hard].numpy()]
        rest = shuffled[~np.isin(shuffled, hard)]
        return np.concatenate([hard, rest])[: s.negatives]

    def _turn(self, rasters: Tensor, scans: NDArray[np.int64], turn: Tensor) -> Tensor:
        """Align positives with their query's heading, turn the query, and leave the negatives."""
        raster, step = self.scans.rasters.raster, 2 * np.pi / self.sectors
        headings = self.scans.headings[scans]  # (t, k)
        # In the query's frame the points of a positive are turned by h_p - h_q.
        sectors = torch.from_numpy(np.round((headings - headings[:, :1]) / step).astype(np.int64))
        sectors[:, 1 + self.scheme.positives :] = 0
        sectors[:, 0] = turn
        flat = raster.turned(rasters.flatten(0, 1), sectors.flatten())
        return flat.view_as(rasters)
