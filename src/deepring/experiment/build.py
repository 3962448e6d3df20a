"""From config values to objects: the one place where things are made of a config."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, cast

import lightning as L
import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers import Logger
from omegaconf import OmegaConf

from deepring.core.ground import Preprocessing
from deepring.core.radon import Turn
from deepring.core.rasters import make_raster, raster_settings
from deepring.data.cache import RasterCache
from deepring.data.datamodule import PlaceDataModule
from deepring.data.dataset import PlaceDataset
from deepring.data.episodes import EpisodeSettings
from deepring.errors import DeepringError
from deepring.experiment.config import Config
from deepring.methods.base import Method
from deepring.methods.deepring import DeepRing, DeepRingSettings
from deepring.training.epoch_lines import EpochLines
from deepring.training.module import DeepRingModule

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


def test_dataset(cfg: Config) -> PlaceDataset:
    """The dataset to test on."""
    return PlaceDataset(cfg.data)


def train_datasets(cfg: Config, test: PlaceDataset) -> list[PlaceDataset]:
    """The datasets to train on: ``train_data``, or that of the test where it is empty."""
    chosen = list(cfg.train_data.values())
    if not chosen:
        return [test]
    names = [config.name for config in chosen]
    if len(set(names)) < len(names):
        raise DeepringError(
            f"train_data: {', '.join(names)} do not differ in name; set train_data.KEY.name"
        )
    return [PlaceDataset(config) for config in chosen]


def deepring_settings(cfg: Config) -> DeepRingSettings:
    """What makes the network's descriptors. Raises DeepringError on values that do not fit."""
    r = cfg.representation
    values = {**plain(r.raster), "preprocessing": plain(cfg.preprocessing)}
    return DeepRingSettings(
        raster=raster_settings(make_raster(values)),
        angles=r.angles,
        bins=r.bins,
        turn=cast("Turn", r.turn),  # checked by the representation
        pool=r.pool,
        aggregation=cfg.aggregation.kind,
        normalisation=cfg.similarity.normalisation,
        similarity=cfg.similarity.kind,
        **plain(cfg.encoder),
    )


def preprocessing_settings(cfg: Config) -> dict[str, Any]:
    """The config's preprocessing, as a raster's settings state it."""
    return asdict(Preprocessing(**plain(cfg.preprocessing)))


def raster_cache(cfg: Config) -> RasterCache:
    """The cache of this machine."""
    return RasterCache(Path(cfg.paths.cache))


def datamodule(
    cfg: Config, datasets: list[PlaceDataset], settings: DeepRingSettings
) -> PlaceDataModule:
    """Episodes and validation sets of the training datasets."""
    return PlaceDataModule(
        datasets,
        make_raster(settings.raster),
        EpisodeSettings(**plain(cfg.episode)),
        raster_cache(cfg),
        seed=cfg.seed,
        workers=cfg.workers,
    )


def module(cfg: Config, datasets: list[PlaceDataset], settings: DeepRingSettings) -> DeepRingModule:
    """The network under training."""
    return DeepRingModule(
        settings.to_dict(),
        validation=[dataset.name for dataset in datasets if dataset.has_validation],
        loss=make(cfg.loss, "loss"),
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
    logger: Logger | bool = False if cfg.logger is None else make(cfg.logger, "logger")
    return make(
        cfg.trainer,
        "trainer",
        callbacks=[*callbacks, *further],
        # Without a bar of its own Lightning would draw another.
        enable_progress_bar="progress" in nodes,
        logger=logger,
        default_root_dir=str(folder),
        # Each process draws its own episodes; see EpisodeOrder.
        use_distributed_sampler=False,
    )


def device(cfg: Config) -> torch.device:
    """Where methods are evaluated: a CUDA device if there is one and the trainer may use it."""
    wanted = str(cfg.trainer.accelerator) in ("auto", "gpu", "cuda")
    return torch.device("cuda" if wanted and torch.cuda.is_available() else "cpu")


def methods(cfg: Config, deepring: DeepRing | None) -> dict[str, Method]:
    """The methods to evaluate: the trained network, where there is one, and the configured."""
    chosen: dict[str, Method] = {} if deepring is None else {"DeepRING": deepring}
    for name, node in cfg.methods.items():
        if node is None:
            continue
        values = plain(node)
        raster = values.pop("raster", None)
        label = values.pop("label", name)
        # A partial first: instantiate would turn a raster given to it into a config.
        method = make_later({**values, "_partial_": True}, f"methods.{name}")
        chosen[label] = method() if raster is None else method(make_raster(raster))
    return chosen
