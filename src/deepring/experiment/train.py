"""Train a method, choose a checkpoint and evaluate it."""

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import lightning as L
from lightning.pytorch.callbacks import Timer

from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.data.session import Session
from deepring.errors import ConfigError, StoppedError
from deepring.evaluation.case import shortened
from deepring.evaluation.pose_errors import PoseErrors
from deepring.evaluation.results import Result
from deepring.experiment import build, loggers
from deepring.experiment.config import Config
from deepring.experiment.evaluate import Evaluation, evaluate
from deepring.experiment.hyperparameters import hyperparameters
from deepring.experiment.plan import distance_to_training, plan_evaluation
from deepring.experiment.record import record_of
from deepring.experiment.run_folder import (
    LinkLatest,
    is_first_process,
    link_latest,
    open_run_folder,
)
from deepring.experiment.signs_of_life import SignsOfLife, TrainingSigns, signs_of_life
from deepring.experiment.start import (
    NOTHING,
    check_resume,
    expect_no_start,
    resumed_from,
    start_from,
)
from deepring.experiment.status import Status, note_failure, read_status, write_status
from deepring.methods.network import NetworkMethod
from deepring.training.datamodule import PlaceDataModule
from deepring.training.module import PlaceModule

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainingOutcome:
    """Folder, checkpoint and results of a training run."""

    folder: Path
    checkpoint: Path | None
    """None if the method learns nothing."""
    results: list[Result]
    """Empty with ``evaluate=false``."""
    poses: list[PoseErrors]
    """Errors of relative poses, of the methods that tell these."""
    score: float | None
    """Validation Recall@1 of the checkpoint; None without validation."""


def train(cfg: Config, folder: Path, *, latest: bool = True) -> TrainingOutcome:
    """Train on the training regions, choose by validation, evaluate on the test regions.

    Everything is written below ``folder``; with ``latest``, the link ``latest`` beside it is set to
    it. A method that learns nothing is only evaluated. Raises DeepringError for a user's mistake.
    """
    if cfg.checkpoint is not None:
        raise ConfigError(
            f"checkpoint: {cfg.checkpoint}, expected null in a training; `deepring evaluate` takes "
            "it, resume=CHECKPOINT goes on with its training, and start_from=CHECKPOINT begins a "
            "new one with its weights"
        )
    L.seed_everything(cfg.seed, workers=True, verbose=False)
    method = build.method(cfg.method)
    if not isinstance(method, NetworkMethod):
        expect_no_start(cfg)
        return _evaluate_alone(cfg, folder, latest=latest)
    datasets = trains, tests = build.datasets(cfg)
    before, resumed = NOTHING, None
    if cfg.resume is not None:  # its weights are those that the training goes on with
        resumed, before = resumed_from(cfg.resume, method)
    elif cfg.start_from is not None:
        before = start_from(method, cfg.start_from)
    # Whatever would fail after the training fails now, before anything is written.
    if cfg.evaluate:
        splits = plan_evaluation(cfg, datasets=datasets, after=True).splits
        seen = [d for d in tests if d.name in before.datasets and d not in trains]
        check_overlap(cfg.overlap, [*trains, *seen], splits)
    datamodule = build.datamodule(cfg, trains, method.raster)
    module = build.module(cfg, trains, method, before)
    if cfg.resume is not None and resumed is not None:
        check_resume(cfg.resume, resumed, module)
    timer = Timer()
    telling = TrainingSigns()
    further = [timer, telling, LinkLatest(folder)] if latest else [timer, telling]
    trainer = build.trainer(cfg, folder, validation=module.validation, further=further)
    with _run_of(cfg, folder) as telling.signs:
        log.info(
            "training %d parameters of %s on %s",
            sum(p.numel() for p in method.parameters() if p.requires_grad),
            method.settings.label,
            shortened([dataset.name for dataset in trains], " + "),
        )
        if trainer.is_global_zero:
            loggers.begin(trainer.loggers, hyperparameters(record_of(cfg)))
        _fit(trainer, module, datamodule, cfg.resume, folder)
        checkpoint, score = _best_checkpoint(trainer, folder)
        found = Evaluation([], [])
        if cfg.evaluate and trainer.is_global_zero:
            found = evaluate(plan_evaluation(cfg, checkpoint, datasets), folder)
            loggers.add_results(trainer.loggers, found.results)
        if trainer.is_global_zero:
            seconds = timer.time_elapsed("train")
            _finish(folder, telling.signs, score, seconds)
    return TrainingOutcome(folder, checkpoint, *found, score)


@contextmanager
def _run_of(cfg: Config, folder: Path) -> Iterator[SignsOfLife | None]:
    """Open the run's folder, and note there how far the block is and how it ends.

    In the first process only; the others have no signs to give.
    """
    if not is_first_process():
        yield None
        return
    before = read_status(folder) if cfg.resume is not None else None
    open_run_folder(record_of(cfg), folder)
    with (
        note_failure(folder),
        signs_of_life(folder, 0.0 if before is None else before.took or 0.0) as signs,
    ):
        yield signs


def _finish(
    folder: Path,
    signs: SignsOfLife | None,
    score: float | None = None,
    seconds: float | None = None,
) -> None:
    took = None if signs is None else signs.took
    write_status(folder, Status("finished", score=score, seconds=seconds, took=took))


def _evaluate_alone(cfg: Config, folder: Path, *, latest: bool) -> TrainingOutcome:
    """Evaluate a method that learns nothing, in a run folder like any other."""
    plan = plan_evaluation(cfg)
    log.info("%s learns nothing: it is evaluated", next(iter(plan.fixed)))
    with _run_of(cfg, folder) as signs:
        found = evaluate(plan, folder)
        _finish(folder, signs)
    if latest:
        link_latest(folder)
    return TrainingOutcome(folder, None, *found, None)


def _fit(
    trainer: L.Trainer,
    module: PlaceModule,
    datamodule: PlaceDataModule,
    resume: str | None,
    folder: Path,
) -> None:
    if resume is not None:  # then the run's own checkpoints lie there
        warnings.filterwarnings("ignore", message="Checkpoint directory .* exists")
    try:
        trainer.fit(module, datamodule=datamodule, ckpt_path=resume, weights_only=True)
    except SystemExit:  # how Lightning ends on Ctrl-C
        raise StoppedError(_interrupted(folder)) from None


def check_overlap(
    overlap: str, datasets: Sequence[PlaceDataset], splits: Sequence[RetrievalSet]
) -> None:
    """Raise ConfigError for scans in training and test, and log the distance between the two."""
    for dataset in datasets:
        for split in splits:
            if not same_files(dataset, split):
                continue
            apart = distance_to_training(dataset, split)
            where = f"{split.name} {split.region}"
            log.info("training scans keep %.0f m from those of %s", apart, where)
            if apart > 0 or overlap == "allow":
                continue
            if overlap == "leave_out":
                log.info("%s holds training scans: it is left out", where)
                continue
            raise ConfigError(
                f"data.regions: scans of {dataset.name} are in the training and in the "
                f"{split.region} region, expected no overlap, since recall would be measured on "
                "training scans; separate data.regions.train and data.regions.test, or give "
                "overlap=allow"
            )


def same_files(dataset: PlaceDataset, split: RetrievalSet) -> bool:
    """Whether a session of the split is one of the dataset's."""

    def folders(*sessions: Session) -> set[Path]:
        return {session.files[0].parent.resolve() for session in sessions}

    training = folders(dataset.database, dataset.query)
    return bool(training & folders(split.database.session, split.query.session))


def _interrupted(folder: Path) -> str:
    last = folder / "checkpoints" / "last.ckpt"
    if not last.is_file():
        return f"training was interrupted before its first checkpoint; {folder} holds no weights"
    return f"training was interrupted; go on with the same command and resume={last}"


def _best_checkpoint(trainer: L.Trainer, folder: Path) -> tuple[Path, float | None]:
    """The checkpoint that validation chose, and its score; saved now if no callback saved one."""
    best = getattr(trainer.checkpoint_callback, "best_model_path", "")
    if best:
        path = Path(best)
        score = getattr(trainer.checkpoint_callback, "best_model_score", None)
        path = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
        return path, None if score is None else float(score)
    path = folder / "checkpoints" / "last.ckpt"
    trainer.save_checkpoint(path)
    return path, None
