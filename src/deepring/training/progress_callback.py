"""How far a training is: over all epochs, as other long work shows it."""

from contextlib import ExitStack
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import ProgressBar

from deepring.progress import Progress, progress_bar


class TrainingProgress(ProgressBar):
    """A bar, or lines, with the batches of all epochs, their rate and the time left."""

    def __init__(self) -> None:
        super().__init__()
        self._open = ExitStack()
        self._show: Progress | None = None
        self._enabled = True

    def disable(self) -> None:
        """Show nothing, as in all processes of a distributed run but the first."""
        self._enabled = False

    def enable(self) -> None:
        """Show it again."""
        self._enabled = True

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Open the bar."""
        if self._enabled and trainer.is_global_zero:
            self._show = self._open.enter_context(progress_bar("training"))

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,  # noqa: ARG002
        outputs: Any,  # noqa: ARG002
        batch: Any,  # noqa: ARG002
        batch_idx: int,
    ) -> None:
        """Count a batch."""
        if self._show is None:
            return
        each, epochs = trainer.num_training_batches, trainer.max_epochs
        done = trainer.current_epoch * each + batch_idx + 1
        known = epochs is not None and epochs > 0
        self._show(int(done), int(each * epochs) if known else int(done))  # type: ignore[operator]

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Close the bar."""
        self._close()

    def on_exception(
        self,
        trainer: L.Trainer,  # noqa: ARG002
        pl_module: L.LightningModule,  # noqa: ARG002
        exception: BaseException,  # noqa: ARG002
    ) -> None:
        """Close the bar where the training is interrupted."""
        self._close()

    def _close(self) -> None:
        self._show = None
        self._open.close()
