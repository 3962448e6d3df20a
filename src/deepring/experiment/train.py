"""Train DeepRING: the function one reads from top to bottom."""

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path

import lightning as L

from deepring.data.datamodule import PlaceDataModule
from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.errors import DeepringError, StoppedError
from deepring.evaluation.results import Result
from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.experiment.evaluate import distance_to_training, evaluate, plan_evaluation
from deepring.experiment.run_folder import LinkLatest, is_first_process, open_run_folder
from deepring.experiment.status import Status, write_status
from deepring.training.module import DeepRingModule, load_deepring

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Trained:
    """What a training run leaves."""

    folder: Path
    checkpoint: Path
    results: list[Result]
    """Empty where ``test=false``."""
    score: float | None
    """Validation Recall@1 of the checkpoint; None without validation."""


def train(cfg: Config, folder: Path, *, latest: bool = True) -> Trained:
    """Train on the training regions, choose by validation, evaluate on the test region.

    Everything is written below ``folder``; ``latest`` beside it comes to point at it. Raises
    DeepringError on a user's mistake.
    """
    L.seed_everything(cfg.seed, workers=True, verbose=False)
    test = build.test_dataset(cfg)
    datasets = build.train_datasets(cfg, test)
    settings = build.deepring_settings(cfg)
    # Whatever would fail after the training fails now, before anything is written.
    if cfg.test:
        check_overlap(cfg, datasets, plan_evaluation(cfg, dataset=test, after=True).split)
    datamodule = build.datamodule(cfg, datasets, settings)
    module = build.module(cfg, datasets, settings)
    _check_resume(cfg, module)
    if is_first_process():
        open_run_folder(cfg, folder)
        write_status(folder, Status("running"))
    link = [LinkLatest(folder)] if latest else []
    trainer = build.trainer(cfg, folder, validated=bool(module.validation), further=link)

    log.info(
        "training %d parameters on %s",
        sum(p.numel() for p in module.method.parameters()),
        " + ".join(dataset.name for dataset in datasets),
    )
    _fit(trainer, module, datamodule, cfg.resume, folder)
    checkpoint, score = _best_checkpoint(trainer, folder)
    results = []
    if cfg.test and trainer.is_global_zero:
        results = evaluate(cfg, folder, plan_evaluation(cfg, checkpoint, test))
    if trainer.is_global_zero:
        write_status(folder, Status("finished", score=score))
    return Trained(folder, checkpoint, results, score)


def _fit(
    trainer: L.Trainer,
    module: DeepRingModule,
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


def _check_resume(cfg: Config, module: DeepRingModule) -> None:
    """Refuse to resume what is no checkpoint, or one of another network or loss."""
    if cfg.resume is None:
        return
    method, _, loss = load_deepring(cfg.resume)
    kept = {**method.settings.to_dict(), "loss": loss}
    asked = {**module.method.settings.to_dict(), "loss": type(module.loss).__name__}
    differing = [name for name in asked if asked[name] != kept[name]]
    if differing:
        raise DeepringError(
            f"resume: {cfg.resume} was trained with other {', '.join(differing)}: "
            + "; ".join(f"{name} {kept[name]}, now {asked[name]}" for name in differing)
            + "; give the same overrides as the run that made it"
        )


def check_overlap(cfg: Config, datasets: list[PlaceDataset], test: RetrievalSet) -> None:
    """Refuse to train on scans that are tested on, and say how far apart the two lie."""
    for dataset in datasets:
        if Path(dataset.config.root).resolve() != Path(cfg.data.root).resolve():
            continue
        apart = distance_to_training(dataset, test)
        log.info("training scans keep %.0f m from the %s region's scans", apart, test.region)
        if apart == 0 and not cfg.allow_overlap:
            raise DeepringError(
                f"data.regions: scans of {dataset.name} are in the training and in the "
                f"{test.region} region, and recall would be measured on what was trained on; "
                "separate data.regions.train and data.regions.test, or say allow_overlap=true"
            )


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
