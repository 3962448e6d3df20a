"""Lightning callbacks: movable checkpoints, a log line per epoch, calls between epochs."""

import logging
from pathlib import Path
from typing import Any, cast

import lightning as L
from lightning.pytorch.callbacks import Callback, ModelCheckpoint

from deepring.methods.network import NetworkMethod
from deepring.training.datamodule import PlaceDataModule

log = logging.getLogger(__name__)


class MovableCheckpoint(ModelCheckpoint):
    """Lightning's ModelCheckpoint for runs whose folder may have moved before they are resumed.

    Lightning itself forgets the best score of a moved run, so that a later, worse epoch would
    replace the best one.
    """

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Change the paths of the state to the current folder, then restore it."""
        folder = Path(str(self.dirpath))

        def here(path: str) -> str:
            return str(folder / Path(path).name) if path else path

        state = dict(state_dict)
        state["dirpath"] = str(self.dirpath)
        for key in ("best_model_path", "kth_best_model_path", "last_model_path"):
            state[key] = here(state[key])
        state["best_k_models"] = {here(path): v for path, v in state["best_k_models"].items()}
        super().load_state_dict(state)


class EpochLines(Callback):
    """Logs loss, accuracy and validation recall after each epoch."""

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Log after validation, which Lightning runs in the epoch; in the first process only."""
        if not trainer.is_global_zero:
            return
        values = trainer.callback_metrics
        names = [n for n in ("train/loss", "train/accuracy", "val/recall@1") if n in values]
        texts = [f"{name} {float(values[name]):.3f}" for name in names]
        log.info("epoch %d/%s: %s", trainer.current_epoch + 1, trainer.max_epochs, ", ".join(texts))


class BetweenEpochs(Callback):
    """Calls `TrainingSet.before_epoch` and `TrainingSet.after_epoch`."""

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Call `before_epoch` before the epoch's first batch, in every process."""
        method = cast("NetworkMethod", pl_module.method)
        _datamodule(trainer).train_set.before_epoch(trainer.current_epoch, method)

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Call `after_epoch` before the epoch's last checkpoint, in every process."""
        means = {
            name.removeprefix("train/"): float(value)
            for name, value in trainer.callback_metrics.items()
            if name.startswith("train/") and name not in ("train/loss", "train/accuracy")
        }
        _datamodule(trainer).train_set.after_epoch(means)


def _datamodule(trainer: L.Trainer) -> PlaceDataModule:
    return cast("PlaceDataModule", trainer.datamodule)  # type: ignore[attr-defined]
