"""Batches to train on and retrieval sets to validate on, as a LightningDataModule."""

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import lightning as L
import torch
from torch.utils.data import DataLoader

from deepring.data.cache import RasterCache, load_rasters
from deepring.data.dataset import PlaceDataset, distances_between
from deepring.rasters import Raster
from deepring.training.batch_order import BatchOrder
from deepring.training.scheme import TrainingScheme, TrainingSet
from deepring.training.training_scans import TrainingScans

log = logging.getLogger(__name__)


class RetrievalBatch(NamedTuple):
    """One validation set as a batch."""

    database: torch.Tensor
    """(d, *raster.shape)."""
    query: torch.Tensor
    """(q, *raster.shape)."""
    distances: torch.Tensor
    """(q, d) float32 metres between the positions."""


class PlaceDataModule(L.LightningDataModule):
    """Training batches from the training regions of one or several datasets.

    Args:
        datasets: what to train on; each gives a validation set unless its share is 0.
        raster: the image of a scan that the method takes.
        scheme: what batches are and how they are drawn, such as `EpisodeScheme`.
        cache: where rasters are kept.
        seed: of the batches.
        workers: processes that draw them; 0 draws them in the training process.
    """

    def __init__(
        self,
        datasets: Sequence[PlaceDataset],
        raster: Raster,
        scheme: TrainingScheme,
        cache: RasterCache,
        seed: int = 0,
        workers: int = 0,
    ) -> None:
        super().__init__()
        self.datasets, self.raster, self.scheme = datasets, raster, scheme
        self.cache, self.seed, self.workers = cache, seed, workers
        self.validation: dict[str, RetrievalBatch] = {}

    def prepare_data(self) -> None:
        """Fill the cache, in one process per node."""
        for dataset in self.datasets:
            for scans in dataset.training():
                what = f"{dataset.name} {scans.session.name}: training scans"
                load_rasters(self.cache, scans, self.raster, what)

    def setup(self, stage: str) -> None:
        """Load what the training regions hold. Raises DeepringError where it is too little."""
        if stage != "fit":
            return
        sessions = []
        for number, dataset in enumerate(self.datasets):
            origin = dataset.database.positions[0]
            for scans in dataset.training():
                readable, rasters, _ = self.cache.load(scans, self.raster)
                sessions.append(TrainingScans.from_session(readable, rasters, number, origin))
        everything = TrainingScans.concatenate(sessions)
        log.info("%d training scans", len(everything))
        self.train_set: TrainingSet[Any] = self.scheme.training_set(everything, self.seed)
        self.validation = {
            dataset.name: self._validation_batch(dataset)
            for dataset in self.datasets
            if dataset.has_validation
        }

    def state_dict(self) -> dict[str, Any]:
        """The training set's own, kept in checkpoints."""
        return self.train_set.state_dict()

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Give the training set the state of the run that goes on."""
        self.train_set.load_state_dict(state_dict)

    def _validation_batch(self, dataset: PlaceDataset) -> RetrievalBatch:
        split = dataset.retrieval("validation")
        database, d = load_rasters(
            self.cache, split.database, self.raster, f"{dataset.name}: validation database"
        )
        query, q = load_rasters(
            self.cache, split.query, self.raster, f"{dataset.name}: validation queries"
        )
        everything = slice(None)
        return RetrievalBatch(
            d[everything], q[everything], distances_between(query.positions, database)
        )

    def train_dataloader(self) -> DataLoader[Any]:
        """Batches of an epoch; each distributed process takes its own."""
        rank, world = (
            (self.trainer.global_rank, self.trainer.world_size) if self.trainer else (0, 1)
        )
        order = BatchOrder(len(self.train_set), rank, world)
        return DataLoader(
            self.train_set,
            batch_size=None,
            sampler=order,
            # Workers start anew each epoch, and so see what the set has learnt meanwhile.
            num_workers=self.workers,
        )

    def val_dataloader(self) -> list[DataLoader[RetrievalBatch]]:
        """One loader per validation set, each of one batch; `validation` holds their names."""
        return [
            DataLoader([batch], batch_size=None)  # type: ignore[arg-type]
            for batch in self.validation.values()
        ]
