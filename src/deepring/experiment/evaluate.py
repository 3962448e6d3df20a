"""Evaluate methods on regions of datasets."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast

from matplotlib.figure import Figure

from deepring.data.dataset import RetrievalSet
from deepring.evaluation.case import in_file_names
from deepring.evaluation.matches import write_matches
from deepring.evaluation.pose_errors import FILE as POSES
from deepring.evaluation.pose_errors import PoseErrors, pose_errors, write_pose_errors
from deepring.evaluation.protocol import Outcome, evaluate_method
from deepring.evaluation.recall_curves import MOST, recall_curves, write_recall_curves
from deepring.evaluation.reranked import evaluate_reranked
from deepring.evaluation.results import Result, write_results
from deepring.evaluation.scoring import FOLDER as DESCRIPTORS
from deepring.evaluation.task import RetrievalTask, load_task
from deepring.experiment.config import EvaluationSettings
from deepring.experiment.hyperparameters import INTEREST, hyperparameters
from deepring.experiment.pictures import evaluation_figures
from deepring.experiment.plan import Plan
from deepring.experiment.projector import project
from deepring.io.files import write_whole
from deepring.localization.candidates import Rerank, RerankSettings
from deepring.methods.method import Method, RelativePoses
from deepring.progress import progress_bar
from deepring.rasters import BevRaster, Raster
from deepring.reports.pose_errors_table import markdown_poses
from deepring.reports.results_table import markdown, markdown_radii
from deepring.reports.style import png
from deepring.reports.tensorboard_events import write_events

log = logging.getLogger(__name__)


class Evaluation(NamedTuple):
    """What an evaluation found."""

    results: list[Result]
    """One per method, split and radius."""
    poses: list[PoseErrors]
    """One per split and method that tells relative poses."""


def evaluate(plan: Plan, folder: Path) -> Evaluation:
    """Evaluate the planned methods on each split.

    Writes ``results.csv``, ``recalls.csv``, ``results.md``, ``retrievals/``, pictures and
    TensorBoard events below ``folder``, and ``relative_poses.csv`` where a method tells these.
    """
    outcomes = [
        (split, evaluate_split(plan, folder, split)) for split in plan.splits if plan.methods(split)
    ]
    every_outcome = [outcome for _, of in outcomes for outcome in of]
    results = [result for outcome in every_outcome for result in outcome.results]
    write_results(folder / "results.csv", results)
    radii = plan.evaluation.radii
    curves = [curve for each in every_outcome for curve in recall_curves(each.matches, radii)]
    write_recall_curves(folder, curves)
    over = plan.evaluation.counted_over
    poses = [outcome.poses for outcome in every_outcome if outcome.poses is not None]
    tables = [markdown(results, radii[0], over), markdown_radii(results, over)]
    if poses:
        write_pose_errors(folder / POSES, poses)
        tables.append(markdown_poses(poses))
    write_whole(folder / "results.md", ["\n".join(tables).encode("utf-8", "backslashreplace")])
    _show(plan, folder, outcomes)
    return Evaluation(results, poses)


def evaluate_split(plan: Plan, folder: Path, split: RetrievalSet) -> list[Outcome]:
    """The outcome of each method on one split; its matches are written to ``retrievals/``."""
    outcomes: list[Outcome] = []
    tasks: dict[Raster, RetrievalTask] = {}  # methods with the same raster share its images

    def task_in(raster: Raster) -> RetrievalTask:
        if raster not in tasks:
            tasks[raster] = load_task(plan.cache, split, raster)
        return tasks[raster]

    for name, method in plan.methods(split).items():
        train = plan.trained_on if method is plan.network else ""
        outcome = _evaluate_alone(plan, folder, name, train, method, task_in(method.raster))
        write_matches(folder, outcome.matches)
        outcomes.append(outcome)
        if plan.evaluation.rerank:
            reranked = _rerank(plan.evaluation, outcome, task_in(BevRaster()))
            for further in reranked:
                write_matches(folder, further.matches)
            outcomes += reranked
    return outcomes


def _evaluate_alone(
    plan: Plan, folder: Path, name: str, train: str, method: Method, task: RetrievalTask
) -> Outcome:
    case = task.case(name, train)
    log.info("%s: %d queries in %d places", case, len(task.query), len(task.database))
    with progress_bar(f"{name}, {case.place}: describing and looking up") as bar:
        outcome = evaluate_method(
            case,
            method,
            task,
            plan.evaluation.radii,
            best=max(MOST, plan.evaluation.candidates) if plan.evaluation.rerank else MOST,
            device=plan.device,
            progress=bar,
            export=folder / DESCRIPTORS if plan.evaluation.descriptors else None,
            wrong_beyond=plan.evaluation.wrong_beyond,
        )
    if not plan.evaluation.relative_poses or not isinstance(method, RelativePoses):
        return outcome
    with progress_bar(f"{name}, {case.place}: relative poses") as bar:
        radius = plan.evaluation.radii[0]
        return replace(outcome, poses=pose_errors(method, task, outcome.matches, radius, bar))


def _rerank(evaluation: EvaluationSettings, outcome: Outcome, task: RetrievalTask) -> list[Outcome]:
    """The same method with its best candidates aligned, one outcome per ``evaluation.rerank``."""
    modes = cast("list[Rerank]", evaluation.rerank)
    settings = RerankSettings(candidates=evaluation.candidates)
    with progress_bar(f"{outcome.case.method}: aligning candidates") as bar:
        beyond = evaluation.wrong_beyond
        return evaluate_reranked(outcome, task, modes, settings, bar, beyond)


def _show(plan: Plan, folder: Path, outcomes: list[tuple[RetrievalSet, list[Outcome]]]) -> None:
    """Write pictures, in one folder per split if there are several, and TensorBoard events."""
    if plan.network is not None:
        plan.network.cpu()
    figures: dict[str, Figure] = {}
    for split, of in outcomes if plan.evaluation.figures else []:
        prefix = f"{in_file_names(split.name)}_{split.region}/" if len(outcomes) > 1 else ""
        pictures = evaluation_figures(of, split, plan.network, plan.evaluation.counted_over)
        figures |= {prefix + name: figure for name, figure in pictures.items()}
    drawn = {name: png(figure) for name, figure in figures.items()}
    for name, picture in drawn.items():
        write_whole(folder / "figures" / f"{name}.png", [picture])
    events = folder / "tensorboard"
    every_outcome = [outcome for _, of in outcomes for outcome in of]
    write_events(events, every_outcome, drawn, hyperparameters(plan.record), INTEREST)
    learned = [(split, outcome) for split, of in outcomes for outcome in of if outcome.case.train]
    if plan.network is not None and learned:
        split, outcome = learned[0]
        task = load_task(plan.cache, split, plan.network.raster)
        radius = plan.evaluation.radii[0]
        project(events, plan.network, task, outcome.matches, radius)
