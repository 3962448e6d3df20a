"""Objects from config values: the only place where a config becomes objects."""

import inspect
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, cast, get_type_hints

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback

from deepring.checks import of_type
from deepring.data.cache import RasterCache
from deepring.data.dataset import DatasetConfig, PlaceDataset
from deepring.errors import ConfigError
from deepring.experiment.callback_nodes import callback_nodes, check_callbacks
from deepring.experiment.config import Config
from deepring.experiment.loggers import make_logger
from deepring.experiment.objects import class_of, make
from deepring.experiment.start import NOTHING, TrainedBefore
from deepring.experiment.trainer_values import check_trainer
from deepring.io.typed import typed, typed_values
from deepring.methods.method import Method
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.rasters import Raster, make_raster, raster_settings
from deepring.training.augmentation import Augmentation
from deepring.training.callbacks import BetweenEpochs, EpochLines
from deepring.training.datamodule import PlaceDataModule
from deepring.training.module import PlaceModule
from deepring.training.scheme import TrainingScheme

log = logging.getLogger(__name__)

#: Keys of a method's node that are not settings.
NOT_SETTINGS = ("_target_", "label", "note")


Datasets = tuple[list[PlaceDataset], list[PlaceDataset]]
"""The datasets to train and to test on; one that is both is opened once."""


def datasets(cfg: Config) -> Datasets:
    """``train_data`` and ``test_data``, or ``data`` where one of them is empty."""
    opened: dict[str, PlaceDataset] = {}

    def open_all(name: str, configs: Mapping[str, DatasetConfig]) -> list[PlaceDataset]:
        nodes = {f"{name}.{key}": config for key, config in configs.items()} or {"data": cfg.data}
        names = [config.name for config in nodes.values()]
        if len(set(names)) < len(names):
            raise ConfigError(
                f"{name}: {', '.join(names)} do not differ in name, expected different names; set "
                f"{name}.KEY.name"
            )
        return [
            opened.setdefault(
                json.dumps(asdict(config), sort_keys=True, default=str), PlaceDataset(config, key)
            )
            for key, config in nodes.items()
        ]

    return open_all("train_data", cfg.train_data), open_all("test_data", cfg.test_data)


def learns(node: Mapping[str, Any] | None) -> bool:
    """Whether the method of a node is a network, which needs training."""
    return node is not None and issubclass(class_of(node), NetworkMethod)


def method(node: Mapping[str, Any] | None, key: str = "method") -> Method:
    """The method of a node; a network has random weights.

    Raises ConfigError that names the key of a value that does not fit.
    """
    if node is None:
        raise ConfigError(f"{key}: null, expected a method, such as {key}=deepring")
    cls = class_of(node, key)
    if issubclass(cls, NetworkMethod):
        return cls(network_settings(node, key))
    values = {name: value for name, value in node.items() if name not in NOT_SETTINGS}
    hints = get_type_hints(cls.__init__)
    names = [name for name in inspect.signature(cls).parameters if name != "raster"]
    raster = {"raster": _raster(values.pop("raster"), key)} if "raster" in values else {}
    arguments = typed_values({n: hints.get(n, Any) for n in names}, values, key, whole=False)
    return cast("Method", cls(**raster, **arguments))


def network(node: Mapping[str, Any] | None, key: str = "method") -> NetworkMethod:
    """The network of a node, with random weights. Raises ConfigError as `method` does."""
    return cast("NetworkMethod", of_type(key, method(node, key), NetworkMethod))


def network_settings(node: Mapping[str, Any], key: str = "method") -> PlainSettings:
    """The settings of a node's network. Raises ConfigError as `method` does."""
    values = {name: value for name, value in node.items() if name not in NOT_SETTINGS}
    if "raster" in values:  # with all its values, as in a checkpoint
        values["raster"] = raster_settings(_raster(values["raster"], key))
    settings: type[PlainSettings] = class_of(node, key).settings_class
    return settings.from_dict(values, key)


def _raster(values: Any, key: str) -> Raster:
    """The raster of a method's node at ``key``."""
    if not isinstance(values, Mapping) or not isinstance(values.get("preprocessing"), dict | None):
        raise ConfigError(f"{key}.raster: {values!r}, expected values by name, such as kind")
    try:
        return make_raster(dict(values))
    except ConfigError as error:
        if not str(error).startswith("raster"):
            raise
        raise ConfigError(f"{key}.{error}") from None


def fixed_methods(cfg: Config) -> dict[str, Method]:
    """The configured methods that learn nothing, by label: ``method`` and ``methods``.

    Raises ConfigError where two methods that differ have one label: a table could hold only one.
    """
    nodes = {f"methods.{name}": node for name, node in cfg.methods.items() if node is not None}
    if cfg.method is not None:
        nodes = {"method": cfg.method, **nodes}
    first: dict[str, str] = {}
    for key, node in nodes.items():
        label = node.get("label", key.rpartition(".")[2])
        if learns(node):
            label = class_of(node, key).settings_class.label
        other = first.setdefault(label, key)
        if node != nodes[other]:
            raise ConfigError(
                f"{key}.label: {label!r}, the label of {other} too, whose settings differ; give it "
                f"a label of its own, {key}.label=NAME, or leave it out, {key}=null"
            )
    fixed = {label: key for label, key in first.items() if not learns(nodes[key])}
    return {label: method(nodes[key], key) for label, key in fixed.items()}


def raster_cache(cfg: Config) -> RasterCache:
    """The cache of this machine."""
    return RasterCache(Path(cfg.paths.cache))


def scheme(node: Mapping[str, Any] | None) -> TrainingScheme:
    """The training scheme. Raises ConfigError for an unknown key or a wrong value."""
    if node is None:
        raise ConfigError(
            "sampling: null, expected the training scheme of the loss, such as sampling=episodes, "
            "sampling=tuples or sampling=batch_hard"
        )
    kind = class_of(node, "sampling")
    if not issubclass(kind, TrainingScheme):
        raise ConfigError(
            f"sampling._target_: {node['_target_']}, expected a subclass of TrainingScheme"
        )
    values = {key: value for key, value in node.items() if key != "_target_"}
    return cast("TrainingScheme", typed(kind, values, "sampling", whole=False))


def augmentation(node: Mapping[str, Any] | None) -> Augmentation | None:
    """What training scans lose. Raises ConfigError for an unknown key or a wrong value."""
    return None if node is None else typed(Augmentation, node, "augmentation", whole=False)


def datamodule(cfg: Config, datasets: list[PlaceDataset], raster: Raster) -> PlaceDataModule:
    """Batches and validation sets of the training datasets."""
    return PlaceDataModule(
        datasets,
        raster,
        scheme(cfg.sampling),
        raster_cache(cfg),
        augmentation=augmentation(cfg.augmentation),
        seed=cfg.seed,
        workers=cfg.workers,
    )


def module(
    cfg: Config,
    datasets: list[PlaceDataset],
    network: NetworkMethod,
    trained_before: TrainedBefore = NOTHING,
) -> PlaceModule:
    """The network under training."""
    names = [*trained_before.datasets, *(dataset.name for dataset in datasets)]
    check_optimizer(cfg)
    return PlaceModule(
        network,
        scheme(cfg.sampling),
        make(cfg.loss, "loss"),
        validation=[dataset.name for dataset in datasets if dataset.has_validation],
        optimizer=partial(make, cfg.optimizer, "optimizer"),
        scheduler=None if cfg.scheduler is None else partial(make, cfg.scheduler, "scheduler"),
        radius=cfg.evaluation.radii[0],
        trained_on="+".join(dict.fromkeys(names)),
        parts=cfg.trained_parts,
        trained_before=trained_before.parts,
    )


def check_optimizer(cfg: Config) -> None:
    """Raise ConfigError for an optimizer or a schedule that could not be made in the training."""
    optimizer = make(cfg.optimizer, "optimizer", [torch.nn.Parameter(torch.zeros(1))])
    of_type("optimizer._target_", optimizer, torch.optim.Optimizer)
    if cfg.scheduler is not None:
        schedule = make(cfg.scheduler, "scheduler", optimizer)
        of_type("scheduler._target_", schedule, torch.optim.lr_scheduler.LRScheduler)


def check_training(cfg: Config) -> None:
    """Raise ConfigError for a value of the training, for a command that does not train."""
    if cfg.sampling is not None:
        scheme(cfg.sampling)
    augmentation(cfg.augmentation)
    if cfg.loss is not None:
        make(cfg.loss, "loss")
    check_optimizer(cfg)
    check_trainer(cfg.trainer)
    callback_nodes(cfg)


def trainer(
    cfg: Config, folder: Path, *, validation: Sequence[str], further: Sequence[Callback] = ()
) -> L.Trainer:
    """Lightning's trainer with the configured callbacks and logger, writing below ``folder``.

    ``further`` callbacks follow the configured ones. Without ``validation``, the names of the
    validation sets, the weights of the last epoch are kept.
    """
    check_trainer(cfg.trainer)
    nodes = check_callbacks(cfg, validation)
    if not validation:
        log.warning("no validation split: the weights of the last epoch are kept")
        for node in nodes.values():
            node.pop("monitor", None)
    callbacks = [make(node, f"callbacks.{name}") for name, node in nodes.items()]
    callbacks += [EpochLines(), BetweenEpochs()]
    return make(
        cfg.trainer,
        "trainer",
        callbacks=[*callbacks, *further],
        # Without a bar of its own Lightning would draw another.
        enable_progress_bar="progress" in nodes,
        logger=make_logger(cfg.logger),
        default_root_dir=str(folder),
        # Each process draws its own batches; see BatchOrder.
        use_distributed_sampler=False,
    )


def device(cfg: Config) -> torch.device:
    """The device for evaluation: CUDA if there is a GPU and the trainer may use it."""
    cuda_allowed = str(cfg.trainer["accelerator"]) in ("auto", "gpu", "cuda")
    return torch.device("cuda" if cuda_allowed and torch.cuda.is_available() else "cpu")
