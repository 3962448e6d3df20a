"""Evaluate methods on regions of datasets, through one and the same code."""

import logging
import math
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from deepring.core.rasters import BevRaster, Raster
from deepring.data.datamodule import load_rasters
from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.errors import DeepringError
from deepring.evaluation.protocol import Outcome, Side, Task, evaluate_method
from deepring.evaluation.reranked import evaluate_reranked
from deepring.evaluation.reranking import Rerank, RerankSettings
from deepring.evaluation.results import Result, write_results
from deepring.evaluation.retrieval import describe_all
from deepring.evaluation.retrievals import write_retrievals
from deepring.evaluation.scoring import FOLDER as DESCRIPTORS
from deepring.evaluation.tables import markdown, markdown_radii
from deepring.experiment import build
from deepring.experiment.config import (
    AggregationConfig,
    Config,
    EncoderConfig,
    RepresentationConfig,
    SimilarityConfig,
    counted_over,
)
from deepring.experiment.hyperparameters import hyperparameters
from deepring.experiment.pictures import evaluation_figures
from deepring.methods.base import Method
from deepring.methods.deepring import DeepRing
from deepring.methods.network import NetworkMethod, class_path
from deepring.progress import progress_bar
from deepring.training.module import load_network
from deepring.viz.board import add_descriptors, write_board
from deepring.viz.style import save

log = logging.getLogger(__name__)

Evaluated = list[tuple[Outcome, Task]]
"""What the methods made of one split, and what each was shown."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be evaluated, checked: nothing is written before it stands."""

    fixed: dict[str, Method]
    """Methods that learn nothing, by label."""
    network: NetworkMethod | None
    trained_on: str
    splits: list[RetrievalSet]
    """Where all are evaluated."""
    left_out: set[tuple[str, str]]
    """Names and regions of the splits that hold scans the network was trained on."""

    def methods(self, split: RetrievalSet) -> dict[str, Method]:
        """The methods to evaluate there, the network first."""
        seen = (split.name, split.region) in self.left_out
        network = {} if self.network is None or seen else {label(self.network): self.network}
        return {**network, **self.fixed}


def plan_evaluation(
    cfg: Config,
    checkpoint: Path | None = None,
    datasets: build.Datasets | None = None,
    *,
    after: bool = False,
) -> Plan:
    """Build the methods and open the test data. Raises DeepringError on a user's mistake.

    ``datasets`` are the config's, where they are open already; ``after`` says that a network is
    yet to be trained, so that there may be none but it.
    """
    network, trained_on = None, ""
    if checkpoint is not None:
        network, trained_on, _ = load_network(checkpoint)
        _check_method(cfg, network, checkpoint)
        network.to(build.device(cfg))
        adopt_settings(cfg, network)
    fixed = build.fixed_methods(cfg)
    if not fixed and network is None and not after:
        raise DeepringError(
            "methods: nothing to evaluate; give checkpoint=FILE or a method such as method=ring"
        )
    trains, tests = build.datasets(cfg) if datasets is None else datasets
    splits = [d.retrieval(region) for d in tests for region in regions_of(cfg, d)]
    if network is None and not after and (cfg.method is None or build.learns(cfg)):
        log.info("no checkpoint=FILE given: no trained network is evaluated")
    if network is None:
        return Plan(fixed, network, trained_on, splits, set())
    known = [d for d in (*trains, *tests) if d.name in trained_on.split("+")]
    seen = [s for s in splits if any(_holds_training(s, d) for d in known)]
    if seen and cfg.overlap != "leave_out":
        log.warning(
            "the network was trained on %s, and by this config the %s region holds training "
            "scans: its figures tell how well it remembers",
            seen[0].name,
            seen[0].region,
        )
        seen = []
    return Plan(fixed, network, trained_on, splits, {(s.name, s.region) for s in seen})


def _holds_training(split: RetrievalSet, dataset: PlaceDataset) -> bool:
    return split.name == dataset.name and distance_to_training(dataset, split) == 0


def regions_of(cfg: Config, dataset: PlaceDataset) -> list[str]:
    """The regions to test on; of a dataset that is all test region the whole stands for both."""
    asked = list(cfg.evaluation.regions)
    if dataset.config.regions.test is None and "whole" in asked:
        return [region for region in asked if region != "test"]
    return asked


def label(network: NetworkMethod) -> str:
    """The method's name in tables."""
    return network.settings.label


def _check_method(cfg: Config, network: NetworkMethod, checkpoint: Path) -> None:
    """Refuse a checkpoint of another method than the one that is asked for."""
    if cfg.method is None or cfg.method["_target_"] == class_path(network):
        return
    asked = str(cfg.method["_target_"])
    raise DeepringError(
        f"checkpoint: {checkpoint} holds a network of {label(network)} ({class_path(network)}), "
        f"but method asks for {asked}; take a checkpoint of that method, or leave method= out"
    )


def distance_to_training(dataset: PlaceDataset, test: RetrievalSet) -> float:
    """Smallest distance (m) from a training scan of the dataset to a scan of ``test``.

    Infinite where the config's training region holds no scan.
    """
    tested = KDTree(np.concatenate([test.database.positions, test.query.positions]))
    try:
        training = dataset.training()
    except DeepringError:
        return math.inf
    return min(float(tested.query(scans.positions)[0].min()) for scans in training)


def adopt_settings(cfg: Config, network: NetworkMethod) -> None:
    """Set the config's model to the checkpoint's, so that what is recorded is what ran.

    Groups such as representation= choose what is trained; with a checkpoint they have no say.

    The checkpoint's preprocessing holds for the network in any case; where the config states
    another one for the other methods, that is said.
    """
    settings = network.settings.to_dict()
    if cfg.method is None or network.settings != build.network_settings(cfg):
        log.info("the network is as its checkpoint states: %s", settings)
    own = settings["raster"]["preprocessing"]
    if own != build.preprocessing_settings(cfg):
        log.warning(
            "preprocessing: the network keeps that of its checkpoint, %s; the other methods "
            "take the config's, %s",
            own,
            build.preprocessing_settings(cfg),
        )
    if not isinstance(network, DeepRing):
        cfg.method = {**(cfg.method or {}), "_target_": class_path(network), **settings}
        cfg.representation = cfg.encoder = cfg.aggregation = cfg.similarity = None
        return
    del settings["raster"]["preprocessing"]
    cfg.method = {"_target_": build.DEEPRING}
    cfg.representation = RepresentationConfig(
        **{key: settings[key] for key in ("raster", "angles", "bins", "turn", "pool")}
    )
    cfg.encoder = EncoderConfig(
        **{key: settings[key] for key in ("widths", "convolutions", "norm", "tau_padding")}
    )
    cfg.aggregation = AggregationConfig(settings["aggregation"])
    cfg.similarity = SimilarityConfig(settings["similarity"], settings["normalisation"])


def evaluate(cfg: Config, folder: Path, plan: Plan) -> list[Result]:
    """Evaluate the planned methods on each split; one row a radius.

    Writes ``results.csv``, ``results.md``, ``retrievals/``, pictures and TensorBoard events below
    ``folder``.
    """
    outcomes = {
        (split.name, split.region): evaluate_split(cfg, folder, plan, split)
        for split in plan.splits
        if plan.methods(split)
    }
    results = [row for of in outcomes.values() for outcome, _ in of for row in outcome.results]
    write_results(folder / "results.csv", results)
    over = counted_over(cfg)
    tables = [markdown(results, cfg.evaluation.radii[0], over), markdown_radii(results, over)]
    (folder / "results.md").write_text("\n".join(tables))
    _draw(cfg, folder, plan, outcomes)
    return results


def evaluate_split(cfg: Config, folder: Path, plan: Plan, split: RetrievalSet) -> Evaluated:
    """What each method makes of one split, and what it was shown."""
    evaluated: Evaluated = []
    tasks: dict[Raster, Task] = {}  # methods of one raster share its images
    for name, method in plan.methods(split).items():
        if method.raster not in tasks:
            tasks[method.raster] = load_task(cfg, split, method.raster)
        task = tasks[method.raster]
        train = plan.trained_on if method is plan.network else ""
        where = f"{split.name} {split.region}"
        log.info(
            "%s, %s: %d queries in %d places", name, where, len(task.query), len(task.database)
        )
        export = folder / DESCRIPTORS if cfg.evaluation.descriptors else None
        with progress_bar(f"{name}, {where}: describing and looking up") as bar:
            outcome = evaluate_method(
                name, method, task, cfg.evaluation.radii, train, build.device(cfg), bar, export
            )
        keep_retrievals(folder, outcome, task)
        evaluated.append((outcome, task))
        evaluated += reranked(cfg, folder, split, outcome, method, task, tasks)
    return evaluated


def reranked(
    cfg: Config,
    folder: Path,
    split: RetrievalSet,
    outcome: Outcome,
    method: Method,
    task: Task,
    tasks: dict[Raster, Task],
) -> Evaluated:
    """The same method with its best candidates aligned, as ``evaluation.rerank`` asks for."""
    modes = cfg.evaluation.rerank
    if not modes:
        return []
    above = BevRaster()
    if above not in tasks:
        tasks[above] = load_task(cfg, split, above)
    settings = RerankSettings(candidates=cfg.evaluation.candidates)
    with progress_bar(f"{outcome.method}: aligning candidates") as bar:
        further = evaluate_reranked(
            outcome,
            method,
            task,
            tasks[above],
            cast("list[Rerank]", modes),
            settings,
            build.device(cfg),
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


def _draw(
    cfg: Config, folder: Path, plan: Plan, outcomes: dict[tuple[str, str], Evaluated]
) -> None:
    """Pictures, in a folder a split where there are several, and TensorBoard."""
    if plan.network is not None:
        plan.network.cpu()
    figures: dict[str, Figure] = {}
    for split in plan.splits:
        of = outcomes.get((split.name, split.region))
        if of is None or not cfg.evaluation.figures:
            continue
        prefix = f"{split.name}_{split.region}/" if len(outcomes) > 1 else ""
        drawn = evaluation_figures(of, split, plan.network, counted_over(cfg))
        figures |= {prefix + name: figure for name, figure in drawn.items()}
    for name, figure in figures.items():
        save(figure, folder / "figures" / f"{name}.png")
    board = folder / "tensorboard"
    everything = [outcome for of in outcomes.values() for outcome, _ in of]
    write_board(board, everything, figures, hyperparameters(cfg))
    shown = next((task for of in outcomes.values() for o, task in of if o.results[0].train), None)
    if plan.network is not None and shown is not None:
        add_database_embedding(board, plan.network, shown)


def load_task(cfg: Config, split: RetrievalSet, raster: Raster) -> Task:
    """The images of both sides as a method wants them, from the cache where they are there."""
    cache = build.raster_cache(cfg)
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
