"""What an evaluation is to do, planned and checked before anything is written."""

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from deepring.data.dataset import PlaceDataset, RetrievalSet
from deepring.errors import DeepringError
from deepring.experiment import build
from deepring.experiment.config import (
    AggregationConfig,
    Config,
    EncoderConfig,
    RepresentationConfig,
    SimilarityConfig,
)
from deepring.methods.base import Method
from deepring.methods.checkpoint import load_network
from deepring.methods.deepring import DeepRing
from deepring.methods.network import NetworkMethod, class_path, network_class

log = logging.getLogger(__name__)


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
        network, trained_on, _ = load_network(checkpoint, own_class(cfg))
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


def own_class(cfg: Config) -> type[NetworkMethod] | None:
    """The class of the config's ``method``, which a checkpoint may name; None for no network."""
    if cfg.method is None or not build.learns(cfg):
        return None
    return network_class(str(cfg.method["_target_"]))


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
        **{key: settings[key] for key in ("raster", "angles", "bins", "theta_range", "pool")}
    )
    cfg.encoder = EncoderConfig(
        **{key: settings[key] for key in ("widths", "convolutions", "norm", "tau_padding", "stem")}
    )
    cfg.aggregation = AggregationConfig(settings["aggregation"])
    cfg.similarity = SimilarityConfig(settings["similarity"], settings["normalisation"])
