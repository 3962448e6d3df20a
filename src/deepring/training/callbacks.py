"""Lightning callbacks: movable checkpoints, a line per epoch, the time between epochs."""

import logging
from pathlib import Path
from typing import Any, cast

import lightning as L
from lightning.pytorch.callbacks import Callback, ModelCheckpoint

from deepring.methods.network import NetworkMethod
from deepring.training.datamodule import PlaceDataModule

log = logging.getLogger(__name__)


class MovableCheckpoint(ModelCheckpoint):
    """Lightning's ModelCheckpoint, but a resumed run may lie elsewhere than when it was stopped.

    Lightning forgets the best score where the folder is another, so that a later, worse epoch
    would take the place of the best one.
    """

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Point the paths of the state at where the files lie now, then restore all."""
        folder = Path(str(self.dirpath))

        def here(path: str) -> str:
            return str(folder / Path(path).name) if path else path

        moved = dict(state_dict)
        moved["dirpath"] = str(self.dirpath)
        for key in ("best_model_path", "kth_best_model_path", "last_model_path"):
            moved[key] = here(moved[key])
        moved["best_k_models"] = {here(path): v for path, v in moved["best_k_models"].items()}
        super().load_state_dict(moved)


class EpochLines(Callback):
    """Logs loss, accuracy and validation recall after each epoch, for runs without a bar."""

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """After validation, which Lightning runs within the epoch; in the first process alone."""
        if not trainer.is_global_zero:
            return
        values = trainer.callback_metrics
        names = [n for n in ("train/loss", "train/accuracy", "val/recall@1") if n in values]
        texts = [f"{name} {float(values[name]):.3f}" for name in names]
        log.info("epoch %d/%s: %s", trainer.current_epoch + 1, trainer.max_epochs, ", ".join(texts))


class BetweenEpochs(Callback):
    """Tells the training set of each epoch's start and end; see `TrainingSet`."""

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Before the epoch's loader is asked for batches, in every process."""
        method = cast("NetworkMethod", pl_module.method)
        _datamodule(trainer).train_set.before_epoch(trainer.current_epoch, method)

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Before the epoch's last checkpoint is written, in every process."""
        means = {
            name.removeprefix("train/"): float(value)
            for name, value in trainer.callback_metrics.items()
            if name.startswith("train/") and name not in ("train/loss", "train/accuracy")
        }
        _datamodule(trainer).train_set.after_epoch(means)


def _datamodule(trainer: L.Trainer) -> PlaceDataModule:
    return cast("PlaceDataModule", trainer.datamodule)  # type: ignore[attr-defined]
