"""`deepring train` and `deepring evaluate`: Hydra composes, one function runs, a table tells."""

import logging
import math
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from deepring.cli.console import console, mistakes_reported
from deepring.cli.group_help import group_help
from deepring.cli.process import tune_process
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.progress import silence

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from deepring.cli.sweeps import Swept
    from deepring.evaluation.results import Result
    from deepring.experiment.config import EvaluationSettings


def train_command(arguments: Sequence[str]) -> None:
    """``deepring train [-m] [KEY=VALUE ...]``.

    ``resume=CHECKPOINT`` goes on in that run's folder; ``-m`` runs a sweep, one job after the
    other or as the launcher has it.
    """
    if _help_is_asked("train", arguments):
        return
    from deepring.cli.sweeps import is_sweep, report_sweep

    if is_sweep(arguments):
        if report_sweep(run_multirun(arguments)):
            sys.exit(1)
        return
    resumed = [a.partition("=")[2] for a in arguments if a.startswith("resume=")]
    if resumed and (folder := run_of(Path(resumed[-1]))) is not None:
        arguments = [*arguments, f"hydra.run.dir={folder}"]
    _run_hydra("train", _train, arguments)


def run_multirun(arguments: Sequence[str]) -> "Swept":
    """The jobs of ``deepring train -m``, and how they ended."""
    from deepring.cli.sweeps import naming, run_sweep

    named = naming(arguments, config_folder())
    return run_sweep(lambda: _run_hydra("train", _sweep_job, [*arguments, *named]))


def _help_is_asked(command: str, arguments: Sequence[str]) -> bool:
    """Print the groups and their options where ``--help`` asks for them."""
    asked = any(argument in ("-h", "--help") for argument in arguments)
    if asked:
        print(group_help(command, config_folder()), end="")
    return asked


def run_of(checkpoint: Path) -> Path | None:
    """The run folder that a checkpoint lies in, None where it lies in none."""
    folder = checkpoint.parent.parent
    inside = checkpoint.is_file() and (folder / "config.yaml").is_file()
    return folder.resolve() if inside else None


def evaluate_command(arguments: Sequence[str]) -> None:
    """``deepring evaluate [checkpoint=FILE] [KEY=VALUE ...]``."""
    if not _help_is_asked("evaluate", arguments):
        _run_hydra("evaluate", _evaluate, arguments)


def _run_hydra(
    name: str, task: Callable[["DictConfig"], float | None], arguments: Sequence[str]
) -> None:
    import hydra

    # DDP starts its further processes as `python argv[0] argv[1:]`.
    sys.argv = [str(Path(__file__).with_name("train.py")), *arguments]
    # Hydra then passes its errors on, and `main` prints them as it prints ours.
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    register_configs()
    hydra.main(version_base="1.3", config_path=str(config_folder()), config_name=name)(task)()


def _sweep_job(composed: "DictConfig") -> float:
    """One job; its validation score is what a search over hyperparameters maximises."""
    from deepring.cli.sweeps import in_parallel, outcome_noted
    from deepring.experiment.config import check_config
    from deepring.experiment.sweep import run_job

    tune_process()
    _keep_lightning_quiet()
    score = None
    with outcome_noted():
        cfg = check_config(composed)
        if in_parallel():
            silence()
            cfg = replace(cfg, callbacks={**cfg.callbacks, "progress": None})
        score = run_job(cfg, run_folder(cfg.paths.run))
    return math.nan if score is None else score


@mistakes_reported
def _train(composed: "DictConfig") -> None:
    from deepring.experiment.config import check_config

    cfg = check_config(composed)
    from deepring.experiment.run_folder import is_first_process
    from deepring.experiment.train import train

    _keep_lightning_quiet()
    trained = train(cfg, run_folder(cfg.paths.run))
    if trained.results:
        show(cfg.evaluation, trained.results)
    if is_first_process():
        if trained.checkpoint is not None:
            console.print(f"checkpoint   {trained.checkpoint}")
        show_folder(trained.folder)


@mistakes_reported
def _evaluate(composed: "DictConfig") -> None:
    from deepring.experiment.config import check_config
    from deepring.experiment.evaluate import evaluate
    from deepring.experiment.plan import plan_evaluation
    from deepring.experiment.run_folder import link_latest, open_run_folder

    cfg = check_config(composed)
    folder = run_folder(cfg.paths.run)
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


def run_folder(path: str) -> Path:
    """The folder that Hydra made for this run, relative to where the command was started."""
    folder = Path(path)
    return folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder


def show(evaluation: "EvaluationSettings", results: "list[Result]") -> None:
    """Print the headline table and, below it, Recall@1 by radius."""
    from deepring.reports.results_table import render, render_radii

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
