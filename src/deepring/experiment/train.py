"""Train a method, choose a checkpoint and evaluate it."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.data.session import Session
from deepring.errors import ConfigError
from deepring.evaluation.pose_errors import PoseErrors
from deepring.evaluation.results import Result
from deepring.experiment import build, loggers
from deepring.experiment.config import Config
from deepring.experiment.evaluate import Evaluation, evaluate
from deepring.experiment.plan import distance_to_training, plan_evaluation
from deepring.experiment.record import record_of
from deepring.experiment.run_folder import (
    LinkLatest,
    is_first_process,
    link_latest,
    open_run_folder,
)
from deepring.experiment.signs_of_life import SignsOfLife, signs_of_life
from deepring.experiment.stage_training import (
    StageTraining,
    begin,
    check_stage,
    train_stages,
)
from deepring.experiment.stages import stages_left
from deepring.experiment.start import expect_no_start
from deepring.experiment.status import Status, note_failure, read_status, write_status

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

    A training in stages trains them one after the other, each from the checkpoint that the one
    before chose, and evaluates the last. Everything is written below ``folder``; with ``latest``,
    the link ``latest`` beside it is set to it. A method that learns nothing is only evaluated.
    Raises DeepringError for a user's mistake.
    """
    if cfg.checkpoint is not None:
        raise ConfigError(
            f"checkpoint: {cfg.checkpoint}, expected null in a training; `deepring evaluate` takes "
            "it, resume=CHECKPOINT goes on with its training, and start_from=CHECKPOINT begins a "
            "new one with its weights"
        )
    if not build.learns(cfg.method):
        build.method(cfg.method)
        expect_no_start(cfg)
        return _evaluate_alone(cfg, folder, latest=latest)
    datasets = trains, tests = build.datasets(cfg)
    stages, ended = stages_left(cfg, folder)
    # Whatever would fail after the training fails now, before anything is written.
    for stage in stages if cfg.stages else []:
        check_stage(stage, trains)
    beginning = begin(stages[0].cfg)
    if cfg.evaluate:
        splits = plan_evaluation(cfg, datasets=datasets, after=True).splits
        seen = [d for d in tests if d.name in beginning.before.datasets and d not in trains]
        check_overlap(cfg.overlap, [*trains, *seen], splits)
    first = StageTraining.of(stages[0], beginning, trains, [LinkLatest(folder)] if latest else [])
    with _run_of(cfg, folder) as signs:
        last, ended = train_stages(first, stages[1:], ended, trains, signs)
        checkpoint = last.checkpoint
        found = Evaluation([], [])
        if cfg.evaluate and last.trainer.is_global_zero:
            found = evaluate(plan_evaluation(cfg, checkpoint, datasets), folder)
            loggers.add_results(last.trainer.loggers, found.results)
        score, seconds = ended[-1].score, sum(each.seconds for each in ended)
        if last.trainer.is_global_zero:
            _finish(folder, signs, score, seconds)
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
