"""One line an epoch in the log, for where no progress bar is drawn."""

import logging

import lightning as L
from lightning.pytorch.callbacks import Callback

log = logging.getLogger(__name__)


class EpochLines(Callback):
    """Logs loss, accuracy and validation recall at the end of each epoch."""

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """After validation, which Lightning runs within the epoch; in the first process alone."""
        if not trainer.is_global_zero:
            return
        shown = ("train/loss", "train/accuracy", "val/recall@1")
        values = trainer.callback_metrics
        texts = [f"{name} {float(values[name]):.3f}" for name in shown if name in values]
        log.info("epoch %d/%s: %s", trainer.current_epoch + 1, trainer.max_epochs, ", ".join(texts))
