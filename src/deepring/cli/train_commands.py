"""`deepring train` and `deepring evaluate`: Hydra composes, one function runs, a table tells."""

import logging
import math
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import hydra
from omegaconf import DictConfig

from deepring.cli.console import console, mistakes_reported
from deepring.cli.process import tune_process
from deepring.cli.sweeps import (
    Swept,
    in_parallel,
    is_sweep,
    naming,
    outcome_noted,
    report_sweep,
    run_sweep,
)
from deepring.evaluation.results import Result
from deepring.experiment.config import Config, EvaluationSettings, check_config
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.run_folder import is_first_process, link_latest, open_run_folder
from deepring.progress import silence
from deepring.reports.results_table import render, render_radii


def train_command(arguments: Sequence[str]) -> None:
    """``deepring train [-m] [KEY=VALUE ...]``.

    ``resume=CHECKPOINT`` goes on in that run's folder; ``-m`` runs a sweep, one job after the
    other or as the launcher has it.
    """
    if is_sweep(arguments):
        if report_sweep(run_multirun(arguments)):
            sys.exit(1)
        return
    resumed = [a.partition("=")[2] for a in arguments if a.startswith("resume=")]
    if resumed and (folder := run_of(Path(resumed[-1]))) is not None:
        arguments = [*arguments, f"hydra.run.dir={folder}"]
    _run_hydra("train", _train, arguments)


def run_multirun(arguments: Sequence[str]) -> Swept:
    """The jobs of ``deepring train -m``, and how they ended."""
    named = naming(arguments, config_folder())
    return run_sweep(lambda: _run_hydra("train", _sweep_job, [*arguments, *named]))


def run_of(checkpoint: Path) -> Path | None:
    """The run folder that a checkpoint lies in, None where it lies in none."""
    folder = checkpoint.parent.parent
    inside = checkpoint.is_file() and (folder / "config.yaml").is_file()
    return folder.resolve() if inside else None


def evaluate_command(arguments: Sequence[str]) -> None:
    """``deepring evaluate [checkpoint=FILE] [KEY=VALUE ...]``."""
    _run_hydra("evaluate", _evaluate, arguments)


def _run_hydra(
    name: str, task: Callable[[DictConfig], float | None], arguments: Sequence[str]
) -> None:
    # DDP starts its further processes as `python argv[0] argv[1:]`.
    sys.argv = [str(Path(__file__).with_name("train.py")), *arguments]
    # Hydra then passes its errors on, and `main` prints them as it prints ours.
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    register_configs()
    hydra.main(version_base="1.3", config_path=str(config_folder()), config_name=name)(task)()


def _sweep_job(composed: DictConfig) -> float:
    """One job; its validation score is what a search over hyperparameters maximises."""
    from deepring.experiment.sweep import run_job

    tune_process()
    _keep_lightning_quiet()
    score = None
    with outcome_noted():
        cfg = check_config(composed)
        if in_parallel():
            silence()
            cfg = replace(cfg, callbacks={**cfg.callbacks, "progress": None})
        score = run_job(cfg, run_folder(cfg))
    return math.nan if score is None else score


@mistakes_reported
def _train(composed: DictConfig) -> None:
    cfg = check_config(composed)
    from deepring.experiment.train import train

    _keep_lightning_quiet()
    trained = train(cfg, run_folder(cfg))
    if trained.results:
        show(cfg.evaluation, trained.results)
    if is_first_process():
        if trained.checkpoint is not None:
            console.print(f"checkpoint   {trained.checkpoint}")
        show_folder(trained.folder)


@mistakes_reported
def _evaluate(composed: DictConfig) -> None:
    from deepring.experiment.evaluate import evaluate
    from deepring.experiment.plan import plan_evaluation

    cfg = check_config(composed)
    folder = run_folder(cfg)
    checkpoint = None if cfg.checkpoint is None else Path(cfg.checkpoint)
    plan = plan_evaluation(cfg, checkpoint)
    open_run_folder(plan.record, folder)
    show(plan.evaluation, evaluate(plan, folder))
    link_latest(folder)
    show_folder(folder)


def _keep_lightning_quiet() -> None:
    """Drop Lightning's tips and device lines; its warnings stay. It sets its level on import."""
    # It calls what torch has renamed; not the user's concern.
    warnings.filterwarnings("ignore", message=".*LeafSpec.*")
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


def run_folder(cfg: Config) -> Path:
    """The folder that Hydra made for this run, relative to where the command was started."""
    folder = Path(cfg.paths.run)
    return folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder


def show(evaluation: EvaluationSettings, results: list[Result]) -> None:
    """Print the headline table and, below it, Recall@1 by radius."""
    over = evaluation.counted_over
    console.print(render(results, evaluation.radii[0], over))
    if len(evaluation.radii) > 1:
        console.print(render_radii(results, over))


def show_folder(folder: Path) -> None:
    """Say where everything lies."""
    if (folder / "results.csv").is_file():
        console.print(f"results      {folder / 'results.csv'}")
    if (folder / "figures").is_dir():
        console.print(f"pictures     {folder / 'figures'}")
    console.print(f"config       {folder / 'config.yaml'}")
    console.print(f"tensorboard  tensorboard --logdir {folder.parent}")
