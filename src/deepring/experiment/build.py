"""From config values to objects: the one place where things are made of a config."""

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import lightning as L
import torch
from hydra.errors import InstantiationException
from hydra.utils import get_class, instantiate
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers import Logger
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from deepring.core.radon import ThetaRange
from deepring.data.cache import RasterCache
from deepring.data.dataset import DatasetConfig, PlaceDataset
from deepring.errors import ConfigError, DeepringError
from deepring.experiment.config import Config
from deepring.methods.base import Method
from deepring.methods.deepring import DeepRingSettings
from deepring.methods.network import NetworkMethod, PlainSettings, network_class
from deepring.rasters import Preprocessing, Raster, make_raster, raster_settings
from deepring.training.callbacks import BetweenEpochs, EpochLines
from deepring.training.datamodule import PlaceDataModule
from deepring.training.module import PlaceModule
from deepring.training.scheme import TrainingScheme

log = logging.getLogger(__name__)

PRECISIONS = ("32-true", "32", "bf16-mixed", "16-mixed")


def plain(node: Any) -> Any:
    """Config values as plain dicts, lists and numbers."""
    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node


def make(node: Any, what: str, *args: Any, **kwargs: Any) -> Any:
    """Hydra's instantiate; a wrong argument is a DeepringError that names the config key."""
    try:
        return instantiate(node, *args, **kwargs)
    except InstantiationException as error:
        cause = error.__cause__
        if isinstance(cause, DeepringError):
            raise cause from None
        reason = str(cause or error).splitlines()[0]
        raise DeepringError(f"{what}: cannot be made of {plain(node)}: {reason}") from error


def make_later(node: Any, what: str) -> Callable[..., Any]:
    """A ``_partial_`` node as a function; a wrong argument is a DeepringError when called."""
    return partial(_call, make(node, what), what)


def _call(function: Callable[..., Any], what: str, *args: Any) -> Any:
    try:
        return function(*args)
    except (TypeError, ValueError) as error:
        raise DeepringError(f"{what}: {error}") from error


class Datasets(NamedTuple):
    """What is trained and tested on; one that is both is opened once."""

    train: list[PlaceDataset]
    test: list[PlaceDataset]


def datasets(cfg: Config) -> Datasets:
    """``train_data`` and ``test_data``, or ``data`` where one of them is empty."""
    opened: dict[str, PlaceDataset] = {}

    def chosen(name: str, configs: dict[str, DatasetConfig]) -> list[PlaceDataset]:
        picked = list(configs.values()) or [cfg.data]
        names = [config.name for config in picked]
        if len(set(names)) < len(names):
            raise DeepringError(
                f"{name}: {', '.join(names)} do not differ in name; set {name}.KEY.name"
            )
        keys = [json.dumps(plain(config), sort_keys=True, default=str) for config in picked]
        return [
            opened.setdefault(key, PlaceDataset(config))
            for key, config in zip(keys, picked, strict=True)
        ]

    return Datasets(chosen("train_data", cfg.train_data), chosen("test_data", cfg.test_data))


def learns(cfg: Config) -> bool:
    """Whether the method is a network. Raises DeepringError where the config names none."""
    if cfg.method is None:
        raise DeepringError("method: null; name one, such as method=deepring")
    target = cfg.method["_target_"]
    return isinstance(found := get_class(target), type) and issubclass(found, NetworkMethod)


def network_settings(cfg: Config) -> PlainSettings:
    """What makes the network's descriptors. Raises DeepringError on values that do not fit."""
    path = str(cfg.method["_target_"])
    if path == DEEPRING:
        return deepring_settings(cfg)
    given = [name for name in DEEPRINGS_OWN if getattr(cfg, name) is not None]
    if given:
        raise DeepringError(
            f"{given[0]}: a group of DeepRING alone, of which {path.rpartition('.')[2]} takes "
            f"nothing; leave {', '.join(given)} out, or take method=deepring"
        )
    values = {key: v for key, v in plain(cfg.method).items() if key not in NOT_SETTINGS}
    raster = {"preprocessing": plain(cfg.preprocessing), **values.pop("raster", {})}
    values["raster"] = raster_settings(make_raster(raster))
    return network_class(path).settings_class.from_dict(values)


def network(cfg: Config) -> NetworkMethod:
    """The network, untrained."""
    settings = network_settings(cfg)
    return network_class(str(cfg.method["_target_"]))(settings)


#: DeepRING's class, and the groups that make its settings.
DEEPRING = "deepring.methods.deepring.DeepRing"
DEEPRINGS_OWN = ("representation", "encoder", "aggregation", "similarity")

#: Keys of a method's node that its settings do not hold.
NOT_SETTINGS = ("_target_", "note", "label")


def deepring_settings(cfg: Config) -> DeepRingSettings:
    """DeepRING's, of its groups."""
    r, e, a, s = cfg.representation, cfg.encoder, cfg.aggregation, cfg.similarity
    if r is None or e is None or a is None or s is None:
        missing = [name for name in DEEPRINGS_OWN if getattr(cfg, name) is None]
        raise DeepringError(f"{missing[0]}: null, but DeepRING is made of it; choose one")
    values = {**plain(r.raster), "preprocessing": plain(cfg.preprocessing)}
    return DeepRingSettings(
        raster=raster_settings(make_raster(values)),
        angles=r.angles,
        bins=r.bins,
        theta_range=cast("ThetaRange", r.theta_range),  # checked by the representation
        pool=r.pool,
        aggregation=a.kind,
        normalisation=s.normalisation,
        similarity=s.kind,
        **plain(e),
    )


def preprocessing_settings(cfg: Config) -> dict[str, Any]:
    """The config's preprocessing, as the settings of a method state it."""
    values = asdict(Preprocessing(**plain(cfg.preprocessing)))
    return {**values, "height": list(values["height"])}


def raster_cache(cfg: Config) -> RasterCache:
    """The cache of this machine."""
    return RasterCache(Path(cfg.paths.cache))


def scheme(cfg: Config) -> TrainingScheme:
    """How the network is trained. Raises ConfigError on a key or a value that is none of it."""
    values = plain(cfg.sampling)
    if values is None:
        raise ConfigError(
            "sampling: null, but training needs batches; choose what the loss goes with, such as "
            "sampling=episodes, sampling=tuples or sampling=batch_hard"
        )
    target = values.pop("_target_")
    kind = make({"_target_": "hydra.utils.get_class", "path": target}, "sampling")
    if not issubclass(kind, TrainingScheme):
        raise ConfigError(f"sampling._target_: {target}, expected a subclass of TrainingScheme")
    known = {field.name: field.type for field in fields(cast("Any", kind))}
    typed = OmegaConf.structured(kind)
    for key, value in values.items():
        if key not in known:
            raise ConfigError(
                f"sampling.{key}: unknown to {kind.__name__}, expected one of {', '.join(known)}; "
                "choose a sampling that goes with the method and the loss, as method=NAME does"
            )
        try:
            typed = OmegaConf.merge(typed, {key: value})
        except OmegaConfBaseException:
            expected = getattr(known[key], "__name__", known[key])
            raise ConfigError(f"sampling.{key}: {value!r}, expected {expected}") from None
    return cast("TrainingScheme", OmegaConf.to_object(typed))


def datamodule(cfg: Config, datasets: list[PlaceDataset], raster: Raster) -> PlaceDataModule:
    """Batches and validation sets of the training datasets."""
    return PlaceDataModule(
        datasets, raster, scheme(cfg), raster_cache(cfg), seed=cfg.seed, workers=cfg.workers
    )


def module(cfg: Config, datasets: list[PlaceDataset], network: NetworkMethod) -> PlaceModule:
    """The network under training."""
    return PlaceModule(
        network,
        scheme(cfg),
        make(cfg.loss, "loss"),
        validation=[dataset.name for dataset in datasets if dataset.has_validation],
        optimizer=make_later(cfg.optimizer, "optimizer"),
        scheduler=None if cfg.scheduler is None else make_later(cfg.scheduler, "scheduler"),
        radius=cfg.evaluation.radii[0],
        trained_on="+".join(dataset.name for dataset in datasets),
    )


def trainer(
    cfg: Config, folder: Path, *, validated: bool, further: Sequence[Callback] = ()
) -> L.Trainer:
    """Lightning's trainer with the configured callbacks and logger, writing below ``folder``.

    ``further`` callbacks follow the configured. Where nothing is held out for validation, the
    last epoch's weights are the ones kept.
    """
    if str(cfg.trainer.precision) not in PRECISIONS:
        raise DeepringError(
            f"trainer.precision: {cfg.trainer.precision}, expected one of {', '.join(PRECISIONS)}; "
            "sinograms and spectra are taken in float32"
        )
    nodes = {name: plain(node) for name, node in cfg.callbacks.items() if node}
    if not validated:
        log.warning("no validation split: the weights of the last epoch are kept")
        for node in nodes.values():
            node.pop("monitor", None)
    callbacks = [make(node, f"callbacks.{name}") for name, node in nodes.items()]
    if "progress" not in nodes:
        callbacks.append(EpochLines())
    callbacks.append(BetweenEpochs())
    logger: Logger | bool = False if cfg.logger is None else make(cfg.logger, "logger")
    return make(
        cfg.trainer,
        "trainer",
        callbacks=[*callbacks, *further],
        # Without a bar of its own Lightning would draw another.
        enable_progress_bar="progress" in nodes,
        logger=logger,
        default_root_dir=str(folder),
        # Each process draws its own batches; see BatchOrder.
        use_distributed_sampler=False,
    )


def device(cfg: Config) -> torch.device:
    """Where methods are evaluated: a CUDA device if there is one and the trainer may use it."""
    wanted = str(cfg.trainer.accelerator) in ("auto", "gpu", "cuda")
    return torch.device("cuda" if wanted and torch.cuda.is_available() else "cpu")


def fixed_methods(cfg: Config) -> dict[str, Method]:
    """The configured methods that learn nothing, by label: ``method`` and ``methods``."""
    nodes = {f"methods.{name}": node for name, node in cfg.methods.items() if node is not None}
    if cfg.method is not None and not learns(cfg):
        nodes = {"method": cfg.method, **nodes}
    chosen: dict[str, Method] = {}
    for name, node in nodes.items():
        values = {key: v for key, v in plain(node).items() if key != "note"}
        raster = values.pop("raster", None)
        label = values.pop("label", name.rpartition(".")[2])
        # A partial first: instantiate would turn a raster given to it into a config.
        method = make_later({**values, "_partial_": True}, name)
        chosen[label] = method() if raster is None else method(make_raster(raster))
    return chosen
