"""Evaluate methods on regions of datasets, through one and the same code."""

import logging
from pathlib import Path
from typing import cast

from matplotlib.figure import Figure

from deepring.data.cache import RasterCache, load_rasters
from deepring.data.dataset import RetrievalSet
from deepring.evaluation.protocol import Outcome, Side, Task, evaluate_method
from deepring.evaluation.reranked import evaluate_reranked
from deepring.evaluation.results import Result, write_results
from deepring.evaluation.retrievals import write_retrievals
from deepring.evaluation.scoring import FOLDER as DESCRIPTORS
from deepring.experiment.hyperparameters import hyperparameters
from deepring.experiment.pictures import evaluation_figures
from deepring.experiment.plan import Plan
from deepring.localization.candidates import Rerank, RerankSettings
from deepring.methods.base import Method
from deepring.methods.describe import describe_all
from deepring.progress import progress_bar
from deepring.rasters.kinds import BevRaster, Raster
from deepring.reports.results_table import markdown, markdown_radii
from deepring.reports.style import save
from deepring.reports.tensorboard_events import add_descriptors, write_board

log = logging.getLogger(__name__)

Evaluated = list[tuple[Outcome, Task]]
"""What the methods made of one split, and what each was shown."""


def evaluate(plan: Plan, folder: Path) -> list[Result]:
    """Evaluate the planned methods on each split; one row a radius.

    Writes ``results.csv``, ``results.md``, ``retrievals/``, pictures and TensorBoard events below
    ``folder``.
    """
    outcomes = {
        (split.name, split.region): evaluate_split(plan, folder, split)
        for split in plan.splits
        if plan.methods(split)
    }
    results = [row for of in outcomes.values() for outcome, _ in of for row in outcome.results]
    write_results(folder / "results.csv", results)
    over = plan.evaluation.counted_over
    tables = [markdown(results, plan.evaluation.radii[0], over), markdown_radii(results, over)]
    (folder / "results.md").write_text("\n".join(tables))
    _draw(plan, folder, outcomes)
    return results


def evaluate_split(plan: Plan, folder: Path, split: RetrievalSet) -> Evaluated:
    """What each method makes of one split, and what it was shown."""
    evaluated: Evaluated = []
    tasks: dict[Raster, Task] = {}  # methods of one raster share its images
    for name, method in plan.methods(split).items():
        if method.raster not in tasks:
            tasks[method.raster] = load_task(plan.cache, split, method.raster)
        task = tasks[method.raster]
        train = plan.trained_on if method is plan.network else ""
        where = f"{split.name} {split.region}"
        log.info(
            "%s, %s: %d queries in %d places", name, where, len(task.query), len(task.database)
        )
        export = folder / DESCRIPTORS if plan.evaluation.descriptors else None
        with progress_bar(f"{name}, {where}: describing and looking up") as bar:
            outcome = evaluate_method(
                name, method, task, plan.evaluation.radii, train, plan.device, bar, export
            )
        keep_retrievals(folder, outcome, task)
        evaluated.append((outcome, task))
        evaluated += reranked(plan, folder, split, outcome, method, task, tasks)
    return evaluated


def reranked(
    plan: Plan,
    folder: Path,
    split: RetrievalSet,
    outcome: Outcome,
    method: Method,
    task: Task,
    tasks: dict[Raster, Task],
) -> Evaluated:
    """The same method with its best candidates aligned, as ``evaluation.rerank`` asks for."""
    modes = plan.evaluation.rerank
    if not modes:
        return []
    above = BevRaster()
    if above not in tasks:
        tasks[above] = load_task(plan.cache, split, above)
    settings = RerankSettings(candidates=plan.evaluation.candidates)
    with progress_bar(f"{outcome.method}: aligning candidates") as bar:
        further = evaluate_reranked(
            outcome,
            method,
            task,
            tasks[above],
            cast("list[Rerank]", modes),
            settings,
            plan.device,
            bar,
        )
    for one in further:
        keep_retrievals(folder, one, task)
    return [(one, task) for one in further]


def keep_retrievals(folder: Path, outcome: Outcome, task: Task) -> None:
    """Write each query's best place."""
    first = outcome.results[0]
    write_retrievals(
        folder,
        *(outcome.method, first.train, first.test, first.region),
        outcome.retrieved,
        task.query.scans.indices,
        task.database.scans.indices,
    )


def _draw(plan: Plan, folder: Path, outcomes: dict[tuple[str, str], Evaluated]) -> None:
    """Pictures, in a folder a split where there are several, and TensorBoard."""
    if plan.network is not None:
        plan.network.cpu()
    figures: dict[str, Figure] = {}
    for split in plan.splits:
        of = outcomes.get((split.name, split.region))
        if of is None or not plan.evaluation.figures:
            continue
        prefix = f"{split.name}_{split.region}/" if len(outcomes) > 1 else ""
        drawn = evaluation_figures(of, split, plan.network, plan.evaluation.counted_over)
        figures |= {prefix + name: figure for name, figure in drawn.items()}
    for name, figure in figures.items():
        save(figure, folder / "figures" / f"{name}.png")
    board = folder / "tensorboard"
    everything = [outcome for of in outcomes.values() for outcome, _ in of]
    write_board(board, everything, figures, hyperparameters(plan.record))
    shown = next((task for of in outcomes.values() for o, task in of if o.results[0].train), None)
    if plan.network is not None and shown is not None:
        add_database_embedding(board, plan.network, shown)


def load_task(cache: RasterCache, split: RetrievalSet, raster: Raster) -> Task:
    """The images of both sides as a method wants them, from the cache where they are there."""
    sides = [
        Side(*load_rasters(cache, scans, raster, f"{split.name} {split.region}: {what}"))
        for scans, what in ((split.database, "database"), (split.query, "queries"))
    ]
    return Task(split.name, split.region, *sides)


def add_database_embedding(board: Path, network: Method, task: Task) -> None:
    """The database's descriptors for TensorBoard's projector, labelled by position."""
    descriptors = describe_all(network, task.database.rasters).cpu()
    labels = [f"{x:.0f}, {y:.0f}" for x, y in task.database.scans.ground_truth]
    add_descriptors(board, descriptors, labels)
