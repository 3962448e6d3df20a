"""Evaluate methods on a region of a dataset, through one and the same code."""

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from deepring.core.rasters import Raster
from deepring.data.datamodule import load_rasters
from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.errors import DeepringError
from deepring.evaluation.protocol import Outcome, Side, Task, evaluate_method
from deepring.evaluation.results import Result, write_results
from deepring.evaluation.retrieval import describe_all
from deepring.evaluation.tables import markdown, markdown_radii
from deepring.experiment import build
from deepring.experiment.config import Config, counted_over
from deepring.experiment.hyperparameters import hyperparameters
from deepring.experiment.pictures import evaluation_figures
from deepring.methods.base import Method
from deepring.methods.deepring import DeepRing
from deepring.progress import progress_bar
from deepring.training.module import load_deepring
from deepring.viz.board import add_descriptors, write_board
from deepring.viz.style import save

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be evaluated, checked: nothing is written before it stands."""

    methods: dict[str, Method]
    network: DeepRing | None
    trained_on: str
    split: RetrievalSet


def plan_evaluation(
    cfg: Config,
    checkpoint: Path | None = None,
    dataset: PlaceDataset | None = None,
    *,
    after: bool = False,
) -> Plan:
    """Build the methods and open the test data. Raises DeepringError on a user's mistake.

    ``dataset`` is the one to test on, where it is open already; ``after`` says that a network is
    yet to be trained, so that there may be none but it.
    """
    network, trained_on = None, ""
    if checkpoint is not None:
        network, trained_on, _ = load_deepring(checkpoint)
        network.to(build.device(cfg))
        adopt_settings(cfg, network)
    methods = build.methods(cfg, network)
    if not methods and not after:
        raise DeepringError(
            "methods: nothing to evaluate; give checkpoint=FILE or a method such as "
            "+method@methods.ring=ring"
        )
    dataset = build.test_dataset(cfg) if dataset is None else dataset
    split = dataset.retrieval(cfg.evaluation.region)
    if network is None and not after:
        log.info("no checkpoint=FILE given: DeepRING is left out")
    remembered = dataset.name in trained_on.split("+") and distance_to_training(dataset, split) == 0
    if remembered:
        log.warning(
            "the network was trained on %s, and by this config the %s region holds training "
            "scans: its figures tell how well it remembers",
            dataset.name,
            split.region,
        )
    return Plan(methods, network, trained_on, split)


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


def adopt_settings(cfg: Config, network: DeepRing) -> None:
    """Set the config's model to the checkpoint's, so that what is recorded is what ran.

    Groups such as representation= choose what is trained; with a checkpoint they have no say.

    The checkpoint's preprocessing holds for the network in any case; where the config states
    another one for the other methods, that is said.
    """
    settings = network.settings.to_dict()
    if settings != build.deepring_settings(cfg).to_dict():
        log.info("the network is as its checkpoint states: %s", settings)
    own = settings["raster"].pop("preprocessing")
    if own != build.preprocessing_settings(cfg):
        log.warning(
            "preprocessing: the network keeps that of its checkpoint, %s; the other methods "
            "take the config's, %s",
            own,
            build.preprocessing_settings(cfg),
        )
    cfg.representation.raster = settings["raster"]
    for key in ("angles", "bins", "turn", "pool"):
        setattr(cfg.representation, key, settings[key])
    for key in ("widths", "convolutions", "norm", "tau_padding"):
        setattr(cfg.encoder, key, settings[key])
    cfg.aggregation.kind = settings["aggregation"]
    cfg.similarity.kind = settings["similarity"]
    cfg.similarity.normalisation = settings["normalisation"]


def evaluate(cfg: Config, folder: Path, plan: Plan) -> list[Result]:
    """Evaluate the planned methods; one row a radius.

    Writes ``results.csv``, ``results.md``, pictures and TensorBoard events below ``folder``.
    """
    split, network = plan.split, plan.network
    outcomes: list[tuple[Outcome, Task]] = []
    tasks: dict[Raster, Task] = {}  # methods of one raster share its images
    for name, method in plan.methods.items():
        if method.raster not in tasks:
            tasks[method.raster] = load_task(cfg, split, method.raster)
        task = tasks[method.raster]
        train = plan.trained_on if method is network else ""
        log.info("%s: %d queries in %d places", name, len(task.query), len(task.database))
        with progress_bar(f"{name}: describing and looking up") as bar:
            outcome = evaluate_method(
                name, method, task, cfg.evaluation.radii, train, build.device(cfg), bar
            )
        outcomes.append((outcome, task))

    results = [row for outcome, _ in outcomes for row in outcome.results]
    write_results(folder / "results.csv", results)
    over = counted_over(cfg)
    tables = [markdown(results, cfg.evaluation.radii[0], over), markdown_radii(results, over)]
    (folder / "results.md").write_text("\n".join(tables))

    if network is not None:
        network.cpu()
    figures = evaluation_figures(outcomes, split, network, over) if cfg.evaluation.figures else {}
    for name, figure in figures.items():
        save(figure, folder / "figures" / f"{name}.png")
    board = folder / "tensorboard"
    write_board(board, [outcome for outcome, _ in outcomes], figures, hyperparameters(cfg))
    if network is not None:
        add_database_embedding(board, network, outcomes[0][1])
    return results


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
