"""`deepring train` and `deepring evaluate`: compose the config, run, and print the results."""

import argparse
import logging
import math
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from deepring.cli.console import console
from deepring.cli.ddp import restartable
from deepring.cli.json_output import print_as
from deepring.cli.mistakes import is_mistake, report_mistakes
from deepring.cli.output_streams import open_streams
from deepring.cli.overrides import checked, is_sweep, quoted, value_of
from deepring.cli.process import tune_process
from deepring.cli.results_content import results_content
from deepring.cli.stop_signals import stop_status
from deepring.errors import ConfigError
from deepring.evaluation.pose_errors import PoseErrors
from deepring.evaluation.results import Result
from deepring.experiment.compose import check_training, in_our_words
from deepring.experiment.config import Config, EvaluationSettings, check_config
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.run_folder import is_first_process, link_latest, open_run_folder
from deepring.experiment.stages import run_of
from deepring.experiment.status import is_finished
from deepring.experiment.sweep_lines import job_begins, job_ended
from deepring.experiment.sweep_names import naming
from deepring.experiment.sweep_outcomes import (
    SweepOutcomes,
    in_parallel,
    note_outcome,
    run_sweep,
)
from deepring.progress import silence
from deepring.reports.pose_errors_table import render_poses
from deepring.reports.results_table import render, render_radii
from deepring.text import printable

log = logging.getLogger(__name__)

#: Config keys of the library's arguments, by name.
_KEYS = {
    "format": "data.format",
    "root": "data.root",
    "name": "data.database or data.query",
}


def train_command(args: argparse.Namespace) -> None:
    """Train once, or run a sweep with ``-m``.

    ``resume=CHECKPOINT`` goes on in that run's folder.
    """
    if is_sweep(args.overrides):
        outcomes = run_multirun(args.overrides)
        text = partial(report_sweep, outcomes)
        print_as(args, "sweep", lambda: sweep_content([outcomes]), text)
        if outcomes.failed:
            sys.exit(1)
        return
    overrides = _for_form(args)
    checkpoint = value_of(overrides, "resume")
    if checkpoint is not None and (folder := run_of(Path(checkpoint))) is not None:
        overrides = [*overrides, quoted("hydra.run.dir", str(folder))]
    _run_hydra("train", lambda composed: _train(composed, args), overrides)


def evaluate_command(args: argparse.Namespace) -> None:
    """Evaluate a checkpoint and the methods that learn nothing."""
    _run_hydra("evaluate", lambda composed: _evaluate(composed, args), _for_form(args))


def _for_form(args: argparse.Namespace) -> list[str]:
    """The checked overrides. Raises ConfigError for JSON of what Hydra prints by itself."""
    overrides = checked(args.overrides)
    if args.form == "json" and any(text.startswith("-") for text in overrides):
        raise ConfigError(
            "--as: json, expected only without flags such as --cfg, which print a config as YAML"
        )
    return overrides


def run_multirun(arguments: Sequence[str]) -> SweepOutcomes:
    """Run the jobs of ``deepring train -m``; on Ctrl-C print their outcomes, and exit."""
    overrides = sweep_overrides(arguments)
    outcomes = run_sweep(lambda: _run_hydra("train", _sweep_job, overrides))
    if outcomes.interrupted:
        done, left = len(outcomes.finished), len(outcomes.failed)
        print(f"sweep        {done} of {done + left} jobs finished", file=sys.stderr)
        say_failed(outcomes)
        print("interrupted; the same command goes on with what is left", file=sys.stderr)
        sys.exit(stop_status())
    return outcomes


def sweep_overrides(arguments: Sequence[str]) -> list[str]:
    """The checked arguments of a sweep, and how its folders are named."""
    overrides = checked(arguments)
    return [*overrides, *naming(overrides, config_folder())]


def report_sweep(outcomes: SweepOutcomes, *, next_steps: bool = True) -> None:
    """Print how many jobs finished, which failed and why, and what makes tables and a page."""
    finished, failed = outcomes.finished, outcomes.failed
    console.print(f"sweep        {len(finished)} of {len(finished) + len(failed)} jobs finished")
    say_failed(outcomes)
    if finished:
        sweep = from_here(finished[0].parent)
        if next_steps and any((folder / "results.csv").is_file() for folder in finished):
            console.print(f"tables       deepring tables {sweep}")
            console.print(f"report       deepring report {sweep}")
        console.print(f"tensorboard  tensorboard --logdir {sweep}")
    if failed:
        console.print("correct the errors above; the same command then goes on with what is left")


def say_failed(outcomes: SweepOutcomes) -> None:
    """Say which jobs failed and why, on standard error."""
    for folder, error in outcomes.failed:
        print(printable(f"failed       {folder.name}: {error}"), file=sys.stderr)


def sweep_content(sweeps: Sequence[SweepOutcomes]) -> dict[str, Any]:
    """How the jobs of sweeps ended, for the schema ``sweep``."""
    jobs: list[tuple[Path, str | None]] = []
    for outcomes in sweeps:
        jobs += [(folder, None) for folder in outcomes.finished]
        jobs += outcomes.failed
    return {
        "sweeps": list(dict.fromkeys(from_here(folder.parent) for folder, _ in jobs)),
        "jobs": [
            {
                "folder": from_here(folder),
                "state": "finished" if error is None else "failed",
                "error": error,
            }
            for folder, error in jobs
        ],
    }


def _run_hydra(
    name: str, task: Callable[[DictConfig], float | None], arguments: Sequence[str]
) -> None:
    # With it, Hydra raises its errors, and `main` prints them like ours.
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    register_configs()
    compose = hydra.main(version_base="1.3", config_path=str(config_folder()), config_name=name)
    with in_our_words(arguments), restartable(arguments):
        compose(task)()


def _sweep_job(composed: DictConfig) -> float:
    """Run one job, and return its validation score, which a search maximises."""
    from deepring.experiment.sweep import run_job

    open_streams()  # it may be the first thing that a process of the launcher does
    tune_process()
    _keep_log_short()
    folder = Path(HydraConfig.get().runtime.output_dir)
    _name_in_log(folder.name)
    score, skipped = None, False
    with note_outcome(is_mistake):
        if not (skipped := is_finished(folder)):
            log.info("%s", job_begins(folder))
        cfg = _checked_training(composed)
        if in_parallel():
            silence()
        score = run_job(cfg, run_folder(cfg.paths.run))
    if not skipped:
        log.info("%s", job_ended(folder))
    return math.nan if score is None else score


@report_mistakes(_KEYS)
def _train(composed: DictConfig, args: argparse.Namespace) -> None:
    cfg = _checked_training(composed)
    from deepring.experiment.train import train

    _keep_log_short()
    outcome = train(cfg, run_folder(cfg.paths.run))
    if not is_first_process():
        return

    def text() -> None:
        if outcome.results:
            show(cfg.evaluation, outcome.results, outcome.poses)
        if outcome.checkpoint is not None:
            console.print(f"checkpoint   {outcome.checkpoint}")
        show_folder(outcome.folder)

    found = (outcome.results, outcome.checkpoint, outcome.score)
    print_as(args, "results", lambda: run_content(outcome.folder, cfg.evaluation, *found), text)


@report_mistakes(_KEYS)
def _evaluate(composed: DictConfig, args: argparse.Namespace) -> None:
    from deepring.experiment.evaluate import evaluate
    from deepring.experiment.plan import plan_evaluation
    from deepring.experiment.start import expect_no_start
    from deepring.experiment.status import Status, write_status

    cfg = check_config(composed)
    expect_no_start(cfg)
    folder = run_folder(cfg.paths.run)
    checkpoint = None if cfg.checkpoint is None else Path(cfg.checkpoint)
    plan = plan_evaluation(cfg, checkpoint)
    open_run_folder(plan.record, folder)
    found = evaluate(plan, folder)
    write_status(folder, Status("finished"))
    link_latest(folder)

    def text() -> None:
        show(plan.evaluation, *found)
        show_folder(folder)
        console.print(f"tables       deepring tables {folder}")

    content = partial(run_content, folder, plan.evaluation, found.results, checkpoint)
    print_as(args, "results", content, text)


def _checked_training(composed: DictConfig) -> Config:
    """The checked config of the running job, with its stages."""
    return check_training(composed, HydraConfig.get().overrides.task)


def _keep_log_short() -> None:
    """Drop Lightning's tips and device lines, but not its warnings. Call it after the import."""
    logging.raiseExceptions = False  # a full disk is told once, not with each line of the log
    # Lightning calls a function that torch has renamed, which the user cannot change.
    warnings.filterwarnings("ignore", message=".*LeafSpec.*")
    # Short epochs are drawn in TensorBoard all the same, every few of them.
    warnings.filterwarnings("ignore", message=".*smaller than the logging interval.*")
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


def _name_in_log(name: str) -> None:
    """Put the job's name before its log lines, since several jobs may write at once."""
    safe = name.replace("%", "%%")
    for handler in logging.getLogger().handlers:
        handler.setFormatter(logging.Formatter(f"[%(asctime)s] {safe}: %(message)s", "%H:%M:%S"))


def run_folder(path: str) -> Path:
    """The folder that Hydra made for this run, relative to where the command was started."""
    return from_here(Path(path))


def from_here(folder: Path) -> Path:
    """The folder as the user sees it from where the command was started."""
    return folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder


def show(evaluation: EvaluationSettings, results: list[Result], poses: list[PoseErrors]) -> None:
    """Print the headline table and, below it, Recall@1 by radius and errors of relative poses."""
    over = evaluation.counted_over
    console.print(render(results, evaluation.radii[0], over))
    if len(evaluation.radii) > 1:
        console.print(render_radii(results, over))
    if poses:
        console.print(render_poses(poses))


def show_folder(folder: Path) -> None:
    """Print the paths of what the run wrote."""
    if (folder / "results.csv").is_file():
        console.print(f"results      {folder / 'results.csv'}")
        console.print(f"report       deepring report {folder}")
    if (folder / "figures").is_dir():
        console.print(f"pictures     {folder / 'figures'}")
    console.print(f"config       {folder / 'config.yaml'}")
    console.print(f"tensorboard  tensorboard --logdir {folder.parent}")


def run_content(
    folder: Path,
    evaluation: EvaluationSettings,
    results: Sequence[Result],
    checkpoint: Path | None = None,
    score: float | None = None,
) -> dict[str, Any]:
    """What a run found and wrote, for the schema ``results``."""
    over = evaluation.counted_over
    content = results_content(results, evaluation.radii[0], over, checkpoint, score)
    names = ("results.csv", "results.md", "config.yaml", "figures", "tensorboard")
    written = [folder / name for name in names if (folder / name).exists()]
    return {"run": folder, **content, "written": written}
