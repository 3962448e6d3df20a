"""Signs of life of a run: its ``status.json`` says every few seconds what it does and how far."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback

from deepring.errors import FileError
from deepring.experiment.status import Status, write_status
from deepring.experiment.workers import Worker
from deepring.progress import watched

#: Seconds from one sign to the next, and where something else begins.
EVERY, ANEW = 20.0, 2.0


class SignsOfLife:
    """Writes the status of a running run.

    Args:
        folder: of the run.
        before: seconds that were worked on it before it was resumed.
        clock: seconds since 1970; another one for tests.
    """

    def __init__(
        self, folder: Path, before: float = 0.0, clock: Callable[[], float] = time.time
    ) -> None:
        self.folder, self.before, self.clock = folder, before, clock
        self.began, self.worker = clock(), Worker.here()
        self.last, self.doing = 0.0, ""
        self.trains = False

    @property
    def took(self) -> float:
        """Seconds of work until now."""
        return self.before + self.clock() - self.began

    def training(
        self, epoch: int, epochs: int | None, share: float | None, within: str = ""
    ) -> None:
        """Tell the epoch, from 1, and the share of the training that is done.

        ``within`` is the stage that the epochs are of, if there are several.
        """
        stage = f"epoch {epoch}" if epochs is None else f"epoch {epoch}/{epochs}"
        self._tell(f"training {within}", f"{within}, {stage}" if within else stage, share)

    def work(self, title: str, done: int, total: int) -> None:
        """Tell other work than training; within a training, its epochs are told."""
        if not self.trains:
            self._tell(title, f"{title}: {done} of {total}", None)

    def _tell(self, doing: str, stage: str, share: float | None) -> None:
        now = self.clock()
        if now - self.last < (EVERY if doing == self.doing else ANEW):
            return
        self.last, self.doing = now, doing
        status = Status(
            "running", took=self.took, stage=stage, share=share, seen=now, worker=self.worker
        )
        with suppress(FileError):  # a full disk is told by what has to be written
            write_status(self.folder, status)


@contextmanager
def signs_of_life(folder: Path, before: float = 0.0) -> Iterator[SignsOfLife]:
    """Note that the run begins, and how far the block is. Raises FileError if it cannot."""
    signs = SignsOfLife(folder, before)
    status = Status("running", took=before, seen=signs.began, worker=signs.worker)
    write_status(folder, status)
    with watched(signs.work):
        yield signs


class TrainingSigns(Callback):
    """Tells the epochs of a training, or of a stage of it.

    Args:
        stage: its name, empty for a training without stages.
        of_whole: where the stage begins and ends, as shares of the training.
    """

    def __init__(self, stage: str = "", of_whole: tuple[float, float] = (0.0, 1.0)) -> None:
        self.signs: SignsOfLife | None = None
        self.stage, self.of_whole = stage, of_whole

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """From here on epochs are told."""
        if self.signs is not None:
            self.signs.trains = True

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,  # noqa: ARG002
        outputs: Any,  # noqa: ARG002
        batch: Any,  # noqa: ARG002
        batch_idx: int,
    ) -> None:
        """Tell how far it is."""
        if self.signs is None:
            return
        epoch, epochs = trainer.current_epoch, trainer.max_epochs
        share = None
        if epochs is not None and epochs > 0:
            done = (epoch + (batch_idx + 1) / float(trainer.num_training_batches)) / epochs
            begin, end = self.of_whole
            share = begin + (end - begin) * done
        else:
            epochs = None
        self.signs.training(epoch + 1, epochs, share, self.stage)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """The training is over: other work is told again."""
        if self.signs is not None:
            self.signs.trains = False
