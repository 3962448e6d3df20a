"""Plans of evaluations, which are checked before anything is written."""

import logging
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial import KDTree

from deepring.data.cache import RasterCache
from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.errors import ConfigError, DeepringError
from deepring.experiment import build
from deepring.experiment.config import Config, EvaluationSettings
from deepring.experiment.objects import class_of
from deepring.experiment.record import record_of
from deepring.methods.method import Method
from deepring.methods.network import NetworkMethod, class_path
from deepring.methods.network_file import load_network
from deepring.rasters import Preprocessing

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Plan:
    """Which methods are evaluated on which scans, and how; all of it is checked."""

    fixed: dict[str, Method]
    """Methods that learn nothing, by label."""
    network: NetworkMethod | None
    trained_on: str
    splits: list[RetrievalSet]
    """The retrieval sets to evaluate on."""
    training_splits: set[tuple[str, str]]
    """Names and regions of the splits on which the network is not evaluated, since they hold
    scans that it was trained on."""
    evaluation: EvaluationSettings
    cache: RasterCache
    device: torch.device
    record: dict[str, Any]
    """The config of the run, with the checkpoint's settings for the network."""

    def methods(self, split: RetrievalSet) -> dict[str, Method]:
        """The methods to evaluate on a split, the network first."""
        overlaps = (split.name, split.region) in self.training_splits
        network = {} if self.network is None or overlaps else {label(self.network): self.network}
        return {**network, **self.fixed}


def plan_evaluation(
    cfg: Config,
    checkpoint: Path | None = None,
    datasets: build.Datasets | None = None,
    *,
    after: bool = False,
) -> Plan:
    """Build the methods and open the test data. Raises DeepringError for a user's mistake.

    ``datasets`` are those of the config if they are open already. With ``after``, the network is
    trained later, so that there may be no other method.
    """
    build.check_training(cfg)
    network, trained_on, device = None, "", build.device(cfg)
    if checkpoint is not None:
        network, trained_on = load_network(checkpoint, own_class(cfg.method))[:2]
        _check_method(cfg.method, network, checkpoint)
        _log_settings(network, cfg.method, cfg.preprocessing)
        network.to(device)
    fixed = build.fixed_methods(cfg)
    if not fixed and network is None and not after:
        raise ConfigError(
            "methods: nothing to evaluate, expected a method; give checkpoint=FILE or a method, "
            "such as method=ring"
        )
    if network is None and not after and (cfg.method is None or build.learns(cfg.method)):
        log.info("without checkpoint=FILE no trained network is evaluated")
    trains, tests = build.datasets(cfg) if datasets is None else datasets
    splits = [
        dataset.retrieval(region)
        for dataset in tests
        for region in regions_of(cfg.evaluation, dataset)
    ]
    training = [d for d in (*trains, *tests) if d.name in trained_on.split("+")]
    return Plan(
        fixed,
        network,
        trained_on,
        splits,
        _training_splits(splits, training, cfg.overlap),
        cfg.evaluation,
        build.raster_cache(cfg),
        device,
        record_of(cfg, network),
    )


def _training_splits(
    splits: list[RetrievalSet], training: list[PlaceDataset], overlap: str
) -> set[tuple[str, str]]:
    """The splits with training scans of the ``training`` datasets.

    Empty, with a warning, unless ``overlap`` is 'leave_out'.
    """
    overlaps = [s for s in splits if any(_holds_training(s, d) for d in training)]
    if overlaps and overlap != "leave_out":
        log.warning(
            "the network was trained on %s, and by this config the %s region holds training "
            "scans: its figures tell how well it remembers",
            overlaps[0].name,
            overlaps[0].region,
        )
        return set()
    return {(split.name, split.region) for split in overlaps}


def _holds_training(split: RetrievalSet, dataset: PlaceDataset) -> bool:
    return split.name == dataset.name and distance_to_training(dataset, split) == 0


def regions_of(evaluation: EvaluationSettings, dataset: PlaceDataset) -> list[str]:
    """The regions to test on, without 'test' if that is the same as 'whole'."""
    regions = evaluation.regions
    if dataset.config.regions.test is None and "whole" in regions:
        return [region for region in regions if region != "test"]
    return regions


def label(network: NetworkMethod) -> str:
    """The method's name in tables."""
    return network.settings.label


def own_class(node: dict[str, Any] | None) -> type[NetworkMethod] | None:
    """The class of the config's ``method``, which a checkpoint may name; None if not a network."""
    return None if node is None or not build.learns(node) else class_of(node)


def _check_method(node: dict[str, Any] | None, network: NetworkMethod, checkpoint: Path) -> None:
    """Raise ConfigError if the checkpoint is of another method than the config."""
    if node is None or class_of(node) is type(network):
        return
    raise ConfigError(
        f"checkpoint: {checkpoint} holds a network of {label(network)} ({class_path(network)}), "
        f"but method asks for {node['_target_']}; name a checkpoint of that method, or leave "
        "method= out"
    )


def _log_settings(
    network: NetworkMethod, node: dict[str, Any] | None, preprocessing: dict[str, Any]
) -> None:
    """Log whether the checkpoint's settings differ from the config's.

    The network always has the checkpoint's settings; the other methods have the config's
    preprocessing.
    """
    if node is None or network.settings != build.network_settings(node):
        log.info("the network has the settings of its checkpoint, not the config's")
    of_network = network.settings.to_dict()["raster"]["preprocessing"]
    of_config = Preprocessing(**preprocessing)
    if Preprocessing(**of_network) != of_config:
        log.warning(
            "preprocessing: the network keeps that of its checkpoint, %s; the other methods "
            "take the config's, %s",
            of_network,
            asdict(of_config),
        )


def distance_to_training(dataset: PlaceDataset, test: RetrievalSet) -> float:
    """Smallest distance (m) from a training scan of the dataset to a scan of ``test``.

    Infinite if the training region of the config holds no scan.
    """
    tree = KDTree(np.concatenate([test.database.positions, test.query.positions]))
    try:
        training = dataset.training()
    except DeepringError:
        return math.inf
    return min(float(tree.query(scans.positions)[0].min()) for scans in training)
