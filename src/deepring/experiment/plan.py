"""What an evaluation is to do, planned and checked before anything is written."""

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
from deepring.experiment.record import record_of
from deepring.methods.method import Method
from deepring.methods.network import NetworkMethod, class_path
from deepring.methods.network_file import load_network
from deepring.rasters import Preprocessing

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be evaluated and how, checked: nothing is written before it stands."""

    fixed: dict[str, Method]
    """Methods that learn nothing, by label."""
    network: NetworkMethod | None
    trained_on: str
    splits: list[RetrievalSet]
    """Where all are evaluated."""
    left_out: set[tuple[str, str]]
    """Names and regions of the splits that hold scans the network was trained on."""
    evaluation: EvaluationSettings
    cache: RasterCache
    device: torch.device
    record: dict[str, Any]
    """The config of the run, with the checkpoint's settings for the network."""

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
    network, trained_on, device = None, "", build.device(cfg)
    if checkpoint is not None:
        network, trained_on, _ = load_network(checkpoint, own_class(cfg.method))
        _check_method(cfg.method, network, checkpoint)
        _say_settings(network, cfg.method, cfg.preprocessing)
        network.to(device)
    fixed = build.fixed_methods(cfg)
    if not fixed and network is None and not after:
        raise ConfigError(
            "methods: nothing to evaluate; give checkpoint=FILE or a method such as method=ring"
        )
    if network is None and not after and (cfg.method is None or build.learns(cfg.method)):
        log.info("no checkpoint=FILE given: no trained network is evaluated")
    trains, tests = build.datasets(cfg) if datasets is None else datasets
    splits = [
        dataset.retrieval(region)
        for dataset in tests
        for region in regions_of(cfg.evaluation, dataset)
    ]
    known = [d for d in (*trains, *tests) if d.name in trained_on.split("+")]
    return Plan(
        fixed,
        network,
        trained_on,
        splits,
        _left_out(splits, known, cfg.overlap),
        cfg.evaluation,
        build.raster_cache(cfg),
        device,
        record_of(cfg, network),
    )


def _left_out(
    splits: list[RetrievalSet], known: list[PlaceDataset], overlap: str
) -> set[tuple[str, str]]:
    """The splits with scans of the ``known`` datasets' training; none unless they are to be left
    out, but that is said."""
    seen = [s for s in splits if any(_holds_training(s, d) for d in known)]
    if seen and overlap != "leave_out":
        log.warning(
            "the network was trained on %s, and by this config the %s region holds training "
            "scans: its figures tell how well it remembers",
            seen[0].name,
            seen[0].region,
        )
        return set()
    return {(split.name, split.region) for split in seen}


def _holds_training(split: RetrievalSet, dataset: PlaceDataset) -> bool:
    return split.name == dataset.name and distance_to_training(dataset, split) == 0


def regions_of(evaluation: EvaluationSettings, dataset: PlaceDataset) -> list[str]:
    """The regions to test on; of a dataset that is all test region the whole stands for both."""
    asked = evaluation.regions
    if dataset.config.regions.test is None and "whole" in asked:
        return [region for region in asked if region != "test"]
    return asked


def label(network: NetworkMethod) -> str:
    """The method's name in tables."""
    return network.settings.label


def own_class(node: dict[str, Any] | None) -> type[NetworkMethod] | None:
    """The class of the config's ``method``, which a checkpoint may name; None for no network."""
    return None if node is None or not build.learns(node) else build.class_of(node)


def _check_method(node: dict[str, Any] | None, network: NetworkMethod, checkpoint: Path) -> None:
    """Refuse a checkpoint of another method than the one that is asked for."""
    if node is None or build.class_of(node) is type(network):
        return
    raise ConfigError(
        f"checkpoint: {checkpoint} holds a network of {label(network)} ({class_path(network)}), "
        f"but method asks for {node['_target_']}; take a checkpoint of that method, or leave "
        "method= out"
    )


def _say_settings(
    network: NetworkMethod, node: dict[str, Any] | None, preprocessing: dict[str, Any]
) -> None:
    """Say where the checkpoint's settings are others than the config's.

    The checkpoint's hold for the network in any case; the other methods take the config's
    preprocessing.
    """
    if node is None or network.settings != build.network_settings(node):
        log.info("the network is as its checkpoint states: %s", network.settings.to_dict())
    own = network.settings.to_dict()["raster"]["preprocessing"]
    others = Preprocessing(**preprocessing)
    if Preprocessing(**own) != others:
        log.warning(
            "preprocessing: the network keeps that of its checkpoint, %s; the other methods "
            "take the config's, %s",
            own,
            asdict(others),
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
