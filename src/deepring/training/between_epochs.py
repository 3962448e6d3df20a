"""Callbacks for training sets that learn between epochs: hard negatives, growing batches."""

from typing import Any, cast

import lightning as L
from lightning.pytorch.callbacks import Callback

from deepring.methods.describe import describe_all
from deepring.methods.network import NetworkMethod
from deepring.training.datamodule import PlaceDataModule
from deepring.training.scan_batches import ScanBatchSet
from deepring.training.tuples import TupleSet


class HardNegatives(Callback):
    """Describes all training scans before an epoch, so that tuples hold hard negatives.

    Only a `TupleSet` with ``hard`` negatives has a use for it, from its epoch ``hard_from`` on.
    The descriptions are the weights' at that moment, so that a resumed run sees the same.
    """

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """In every process of a distributed run."""
        module = cast("PlaceDataModule", trainer.datamodule)  # type: ignore[attr-defined]
        tuples = module.train_set
        if not isinstance(tuples, TupleSet) or not tuples.settings.hard:
            return
        if trainer.current_epoch < tuples.settings.hard_from:
            return
        method = cast("NetworkMethod", pl_module.method)
        descriptors = describe_all(method, tuples.pool.rasters, device=pl_module.device)
        tuples.learn(method.vectors(descriptors).float().cpu())


class GrowingBatches(Callback):
    """Grows the batches of a `ScanBatchSet` where too few triplets were active (EgoNN)."""

    def __init__(self) -> None:
        self.size: int | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Take up the size of a resumed run."""
        batches = trainer.datamodule.train_set  # type: ignore[attr-defined]
        if isinstance(batches, ScanBatchSet) and self.size is not None:
            batches.size = self.size

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """By the epoch's mean share of active triplets."""
        batches = trainer.datamodule.train_set  # type: ignore[attr-defined]
        active = trainer.callback_metrics.get("train/active")
        if not isinstance(batches, ScanBatchSet) or active is None:
            return
        if float(active) < batches.settings.expand_below:
            batches.expand()
        self.size = batches.size

    def state_dict(self) -> dict[str, Any]:
        """The size, kept in checkpoints."""
        return {"size": self.size}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """The size of the run that goes on."""
        self.size = state_dict["size"]
