"""Training batches and validation sets as a LightningDataModule."""

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import lightning as L
import numpy as np
import torch
from torch.utils.data import DataLoader

from deepring.data.cache import RasterCache, load_rasters
from deepring.data.dataset import PlaceDataset, distances_between
from deepring.rasters import Raster
from deepring.training.augmentation import Augmentation, AugmentedSet, cell_azimuths
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
        datasets: training datasets, each with a validation set unless its share is 0.
        raster: the raster of the method.
        scheme: samples the batches, e.g. `EpisodeScheme`.
        cache: cache of rasters.
        seed: random seed of the batches.
        workers: processes that sample batches; with 0, the training process does.
        augmentation: what training scans lose; validation sets stay whole. Raises ConfigError for
            a raster that is no occupancy.
    """

    def __init__(
        self,
        datasets: Sequence[PlaceDataset],
        raster: Raster,
        scheme: TrainingScheme,
        cache: RasterCache,
        seed: int = 0,
        workers: int = 0,
        augmentation: Augmentation | None = None,
    ) -> None:
        super().__init__()
        self.datasets, self.raster, self.scheme = datasets, raster, scheme
        self.cache, self.seed, self.workers = cache, seed, workers
        self.augmentation = augmentation
        if augmentation is not None:
            cell_azimuths(raster)  # refuses another raster before anything is read
        self.validation: dict[str, RetrievalBatch] = {}

    def prepare_data(self) -> None:
        """Fill the cache, in one process per node."""
        for dataset in self.datasets:
            for scans in dataset.training():
                what = f"{dataset.name} {scans.session.name}: training scans"
                load_rasters(self.cache, scans, self.raster, what)

    def setup(self, stage: str) -> None:
        """Load the scans of the training regions. Raises DataError for too few of them."""
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
        batches = self.scheme.training_set(everything, self.seed)
        self.train_set: TrainingSet[Any] = batches
        if self.augmentation is not None:
            self.train_set = AugmentedSet(batches, self.augmentation, self.raster, self.seed)
        self.validation = {
            dataset.name: self._validation_batch(dataset)
            for dataset in self.datasets
            if dataset.has_validation
        }

    def state_dict(self) -> dict[str, Any]:
        """The state of the training set, for checkpoints."""
        return self.train_set.state_dict()

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the state of the training set of a resumed run."""
        self.train_set.load_state_dict(state_dict)

    def _validation_batch(self, dataset: PlaceDataset) -> RetrievalBatch:
        split = dataset.retrieval("validation")
        database, d = load_rasters(
            self.cache, split.database, self.raster, f"{dataset.name}: validation database"
        )
        query, q = load_rasters(
            self.cache, split.query, self.raster, f"{dataset.name}: validation queries"
        )
        every = slice(None)
        distances = distances_between(query.positions, database)
        if split.before is not None:  # a place that is too recent is nowhere near
            before = split.before[np.searchsorted(split.query.indices, query.indices)]
            recent = torch.from_numpy(database.indices >= before[:, None])
            distances = distances.masked_fill(recent, torch.inf)
        return RetrievalBatch(d[every], q[every], distances)

    def train_dataloader(self) -> DataLoader[Any]:
        """The batches of an epoch; each distributed process has its own."""
        rank, world = (
            (self.trainer.global_rank, self.trainer.world_size) if self.trainer else (0, 1)
        )
        order = BatchOrder(len(self.train_set), rank, world)
        return DataLoader(
            self.train_set,
            batch_size=None,
            sampler=order,
            # Workers restart every epoch, so that they see changes of the set between epochs.
            num_workers=self.workers,
        )

    def val_dataloader(self) -> list[DataLoader[RetrievalBatch]]:
        """One loader of one batch per validation set; ``validation`` holds their names."""
        return [
            DataLoader([batch], batch_size=None)  # type: ignore[arg-type]
            for batch in self.validation.values()
        ]
