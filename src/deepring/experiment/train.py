"""Train DeepRING: the function one reads from top to bottom."""

import logging
from dataclasses import dataclass
from pathlib import Path

import lightning as L

from deepring.errors import DeepringError
from deepring.evaluation.results import Result
from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.experiment.evaluate import evaluate
from deepring.experiment.run_folder import is_first_process, open_run_folder

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Trained:
    """What a training run leaves."""

    folder: Path
    checkpoint: Path
    results: list[Result]
    """Empty where ``test=false``."""


def train(cfg: Config, folder: Path) -> Trained:
    """Train on the training regions, choose by validation, evaluate on the test region.

    Everything is written below ``folder``. Raises DeepringError on a user's mistake.
    """
    resume = _checkpoint_to_resume(cfg)
    L.seed_everything(cfg.seed, workers=True, verbose=False)

    datasets = build.train_datasets(cfg)
    settings = build.deepring_settings(cfg)
    datamodule = build.datamodule(cfg, datasets, settings)
    module = build.module(cfg, datasets, settings)
    if is_first_process():
        open_run_folder(cfg, folder)
    trainer = build.trainer(cfg, folder, validated=bool(module.validation))

    log.info(
        "training %d parameters on %s",
        sum(p.numel() for p in module.method.parameters()),
        " + ".join(dataset.name for dataset in datasets),
    )
    try:
        trainer.fit(module, datamodule=datamodule, ckpt_path=resume, weights_only=True)
    except SystemExit:  # how Lightning ends on Ctrl-C
        raise DeepringError(_interrupted(folder)) from None

    checkpoint = _best_checkpoint(trainer, folder)
    results = []
    if cfg.test and trainer.is_global_zero:
        results = evaluate(cfg, folder, checkpoint)
    return Trained(folder, checkpoint, results)


def _checkpoint_to_resume(cfg: Config) -> str | None:
    if cfg.resume is not None and not Path(cfg.resume).is_file():
        raise DeepringError(f"resume: {cfg.resume} is no file; give a run's checkpoints/last.ckpt")
    return cfg.resume


def _interrupted(folder: Path) -> str:
    last = folder / "checkpoints" / "last.ckpt"
    if not last.is_file():
        return f"training was interrupted before its first checkpoint; {folder} holds no weights"
    return f"training was interrupted; go on with the same command and resume={last}"


def _best_checkpoint(trainer: L.Trainer, folder: Path) -> Path:
    """The checkpoint chosen by validation; saved now where no callback saved one."""
    saved = getattr(trainer.checkpoint_callback, "best_model_path", "")
    if saved:
        path = Path(saved)
        return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    path = folder / "checkpoints" / "last.ckpt"
    trainer.save_checkpoint(path)
    return path
