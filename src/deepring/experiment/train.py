"""Train a method: the function one reads from top to bottom."""

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import lightning as L
from lightning.pytorch.callbacks import Timer

from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.data.session import Session
from deepring.errors import DeepringError, StoppedError
from deepring.evaluation.results import Result
from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.experiment.evaluate import evaluate
from deepring.experiment.plan import distance_to_training, plan_evaluation
from deepring.experiment.run_folder import (
    LinkLatest,
    is_first_process,
    link_latest,
    open_run_folder,
)
from deepring.experiment.status import Status, write_status
from deepring.methods.checkpoint import load_network
from deepring.training.datamodule import PlaceDataModule
from deepring.training.module import PlaceModule

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Trained:
    """What a training run leaves."""

    folder: Path
    checkpoint: Path | None
    """None where the method learns nothing."""
    results: list[Result]
    """Empty where ``evaluate=false``."""
    score: float | None
    """Validation Recall@1 of the checkpoint; None without validation."""


def train(cfg: Config, folder: Path, *, latest: bool = True) -> Trained:
    """Train on the training regions, choose by validation, evaluate on the test regions.

    Everything is written below ``folder``; ``latest`` beside it comes to point at it. A method
    that learns nothing is evaluated. Raises DeepringError on a user's mistake.
    """
    L.seed_everything(cfg.seed, workers=True, verbose=False)
    if not build.learns(cfg):
        return _evaluate_alone(cfg, folder, latest=latest)
    both = build.datasets(cfg)
    datasets = both.train
    network = build.network(cfg)
    # Whatever would fail after the training fails now, before anything is written.
    if cfg.evaluate:
        splits = plan_evaluation(cfg, datasets=both, after=True).splits
        check_overlap(cfg, datasets, splits)
    datamodule = build.datamodule(cfg, datasets, network.raster)
    module = build.module(cfg, datasets, network)
    _check_resume(cfg, module)
    if is_first_process():
        open_run_folder(cfg, folder)
        write_status(folder, Status("running"))
    timer = Timer()
    further = [timer, LinkLatest(folder)] if latest else [timer]
    trainer = build.trainer(cfg, folder, validated=bool(module.validation), further=further)

    log.info(
        "training %d parameters of %s on %s",
        sum(p.numel() for p in module.method.parameters()),
        network.settings.label,
        " + ".join(dataset.name for dataset in datasets),
    )
    _fit(trainer, module, datamodule, cfg.resume, folder)
    checkpoint, score = _best_checkpoint(trainer, folder)
    results = []
    if cfg.evaluate and trainer.is_global_zero:
        results = evaluate(cfg, folder, plan_evaluation(cfg, checkpoint, both))
    if trainer.is_global_zero:
        seconds = timer.time_elapsed("train")
        write_status(folder, Status("finished", score=score, seconds=seconds))
    return Trained(folder, checkpoint, results, score)


def _evaluate_alone(cfg: Config, folder: Path, *, latest: bool) -> Trained:
    """A method that learns nothing, in a run folder like the others'."""
    log.info("%s learns nothing: it is evaluated", cfg.method.get("label", cfg.method["_target_"]))
    plan = plan_evaluation(cfg)
    open_run_folder(cfg, folder)
    write_status(folder, Status("running"))
    results = evaluate(cfg, folder, plan)
    write_status(folder, Status("finished"))
    if latest:
        link_latest(folder)
    return Trained(folder, None, results, None)


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


def _check_resume(cfg: Config, module: PlaceModule) -> None:
    """Refuse to resume what is no checkpoint, or one of another network or loss."""
    if cfg.resume is None:
        return
    if not cfg.resume.endswith(".ckpt"):
        raise DeepringError(
            f"resume: {cfg.resume}, expected the .ckpt of a run, which holds the state of the "
            "training and not the network alone"
        )
    method, _, loss = load_network(cfg.resume, type(module.method))
    kept = {"method": method.settings.label, **method.settings.to_dict(), "loss": loss}
    own = module.method.settings
    asked = {"method": own.label, **own.to_dict(), "loss": type(module.loss).__name__}
    differing = [name for name in asked if asked[name] != kept.get(name)]
    if differing:
        raise DeepringError(
            f"resume: {cfg.resume} was trained with other {', '.join(differing)}: "
            + "; ".join(f"{name} {kept.get(name)}, now {asked[name]}" for name in differing)
            + "; give the same overrides as the run that made it"
        )


def check_overlap(
    cfg: Config, datasets: Sequence[PlaceDataset], splits: Sequence[RetrievalSet]
) -> None:
    """Refuse to train on scans that are tested on, and say how far apart the two lie."""
    for dataset in datasets:
        for split in splits:
            if not same_files(dataset, split):
                continue
            apart = distance_to_training(dataset, split)
            where = f"{split.name} {split.region}"
            log.info("training scans keep %.0f m from those of %s", apart, where)
            if apart > 0 or cfg.overlap == "allow":
                continue
            if cfg.overlap == "leave_out":
                log.info("%s holds training scans: it is left out", where)
                continue
            raise DeepringError(
                f"data.regions: scans of {dataset.name} are in the training and in the "
                f"{split.region} region, and recall would be measured on what was trained on; "
                "separate data.regions.train and data.regions.test, or say overlap=allow"
            )


def same_files(dataset: PlaceDataset, split: RetrievalSet) -> bool:
    """Whether a session of the split is one of the dataset's."""

    def folders(*sessions: Session) -> set[Path]:
        return {session.files[0].parent.resolve() for session in sessions}

    trained = folders(dataset.database, dataset.query)
    return bool(trained & folders(split.database.session, split.query.session))


def _interrupted(folder: Path) -> str:
    last = folder / "checkpoints" / "last.ckpt"
    if not last.is_file():
        return f"training was interrupted before its first checkpoint; {folder} holds no weights"
    return f"training was interrupted; go on with the same command and resume={last}"


def _best_checkpoint(trainer: L.Trainer, folder: Path) -> tuple[Path, float | None]:
    """The checkpoint chosen by validation and its score; saved now where no callback saved one."""
    saved = getattr(trainer.checkpoint_callback, "best_model_path", "")
    if saved:
        path = Path(saved)
        score = getattr(trainer.checkpoint_callback, "best_model_score", None)
        shown = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
        return shown, None if score is None else float(score)
    path = folder / "checkpoints" / "last.ckpt"
    trainer.save_checkpoint(path)
    return path, None
