"""One stage of a training: what it needs, made before anything is written, and its run."""

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import lightning as L
from lightning.pytorch.callbacks import Callback, Timer

from deepring.data.dataset import PlaceDataset
from deepring.errors import ConfigError, StoppedError
from deepring.evaluation.case import shortened
from deepring.experiment import build, loggers
from deepring.experiment.callback_nodes import check_callbacks
from deepring.experiment.config import Config
from deepring.experiment.hyperparameters import hyperparameters
from deepring.experiment.record import record_of
from deepring.experiment.signs_of_life import SignsOfLife, TrainingSigns
from deepring.experiment.stages import Stage, StageOutcome, begun_with, last_checkpoint
from deepring.experiment.start import (
    NOTHING,
    TrainedBefore,
    check_resume,
    resumed_from,
    start_from,
)
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import TrainedNetwork
from deepring.training.datamodule import PlaceDataModule
from deepring.training.module import PlaceModule

log = logging.getLogger(__name__)


class Beginning(NamedTuple):
    """The network as a stage begins with it."""

    method: NetworkMethod
    before: TrainedBefore
    resumed: TrainedNetwork | None
    """The network of the run that goes on, if one does."""


def begin(cfg: Config) -> Beginning:
    """Seed everything, and make the network: random, of an earlier stage, or of a run that goes on.

    Raises ConfigError for a checkpoint that does not fit.
    """
    L.seed_everything(cfg.seed, workers=True, verbose=False)
    method = build.network(cfg.method)
    if cfg.resume is not None:  # its weights are those that the training goes on with
        resumed, before = resumed_from(cfg.resume, method)
        return Beginning(method, before, resumed)
    if cfg.start_from is not None:
        return Beginning(method, start_from(method, cfg.start_from), None)
    return Beginning(method, NOTHING, None)


@dataclass(frozen=True, eq=False)
class StageTraining:
    """A stage that can be trained."""

    stage: Stage
    module: PlaceModule
    datamodule: PlaceDataModule
    trainer: L.Trainer
    timer: Timer
    telling: TrainingSigns

    @classmethod
    def of(
        cls,
        stage: Stage,
        beginning: Beginning,
        trains: list[PlaceDataset],
        further: Sequence[Callback] = (),
    ) -> "StageTraining":
        """Make everything that the stage needs; nothing is written.

        Raises ConfigError for a value that does not fit.
        """
        cfg, method = stage.cfg, beginning.method
        datamodule = build.datamodule(cfg, trains, method.raster)
        module = build.module(cfg, trains, method, beginning.before)
        if cfg.resume is not None and beginning.resumed is not None:
            check_resume(cfg.resume, beginning.resumed, module)
        timer, telling = Timer(), TrainingSigns(stage.name, stage.of_whole)
        trainer = build.trainer(
            cfg, stage.folder, validation=module.validation, further=[timer, telling, *further]
        )
        return cls(stage, module, datamodule, trainer, timer, telling)

    def run(self, signs: SignsOfLife | None) -> StageOutcome:
        """Train, and tell how far it is. Raises StoppedError on Ctrl-C."""
        self.telling.signs = signs
        stage, trainer, method = self.stage, self.trainer, self.module.method
        log.info(
            "%straining %d parameters of %s on %s",
            f"stage {stage.name}: " if stage.name else "",
            sum(p.numel() for p in method.parameters() if p.requires_grad),
            method.settings.label,
            shortened([dataset.name for dataset in self.datamodule.datasets], " + "),
        )
        if trainer.is_global_zero:
            loggers.begin(trainer.loggers, hyperparameters(record_of(stage.cfg)))
        _fit(trainer, self.module, self.datamodule, stage)
        score = None
        if self._best:
            score = getattr(trainer.checkpoint_callback, "best_model_score", None)
        else:  # no callback saved one
            trainer.save_checkpoint(self.checkpoint)
        seconds = self.timer.time_elapsed("train")
        return StageOutcome(self.checkpoint.name, None if score is None else float(score), seconds)

    @property
    def checkpoint(self) -> Path:
        """The checkpoint that the callbacks chose; the last one without these."""
        path = Path(self._best) if self._best else self.stage.last_checkpoint
        return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path

    @property
    def _best(self) -> str:
        return getattr(self.trainer.checkpoint_callback, "best_model_path", "")


def check_stage(stage: Stage, trains: list[PlaceDataset]) -> None:
    """Raise ConfigError, with the stage's name, for what would fail once the stage begins."""
    try:
        build.check_training(stage.cfg)
        module = build.module(stage.cfg, trains, build.network(stage.cfg.method))
        check_callbacks(stage.cfg, module.validation)
    except ConfigError as error:
        raise ConfigError(f"stages.{stage.name}: {error}") from error


def train_stages(
    first: StageTraining,
    later: Sequence[Stage],
    ended: Sequence[StageOutcome],
    trains: list[PlaceDataset],
    signs: SignsOfLife | None,
) -> tuple[StageTraining, list[StageOutcome]]:
    """Train one stage after the other, each from the checkpoint that the one before chose.

    Args:
        first: of those that are left.
        later: those after it.
        ended: how the ones before it have ended.
        trains: the datasets.
        signs: that the run gives, in its first process.

    Returns:
        The last one, and how each has ended.
    """
    training, outcomes = first, [*ended, first.run(signs)]
    for each in later:
        if training.trainer.is_global_zero:
            training.stage.end(outcomes[-1])
        stage = begun_with(each, training.checkpoint)
        training = StageTraining.of(stage, begin(stage.cfg), trains)
        outcomes.append(training.run(signs))
    return training, outcomes


def _fit(
    trainer: L.Trainer, module: PlaceModule, datamodule: PlaceDataModule, stage: Stage
) -> None:
    resume = stage.cfg.resume
    if resume is not None:  # then the run's own checkpoints lie there
        warnings.filterwarnings("ignore", message="Checkpoint directory .* exists")
    try:
        trainer.fit(module, datamodule=datamodule, ckpt_path=resume, weights_only=True)
    except SystemExit:  # how Lightning ends on Ctrl-C
        raise StoppedError(_interrupted(stage)) from None


def _interrupted(stage: Stage) -> str:
    run = stage.folder if not stage.name else Path(stage.cfg.paths.run)
    last = last_checkpoint(run)
    if last is None:
        return f"training was interrupted before its first checkpoint; {run} holds no weights"
    return f"training was interrupted; go on with the same command and resume={last}"
