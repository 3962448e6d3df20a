"""The config of a training as it would be composed, and that of its stages."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf

from deepring.errors import ConfigError
from deepring.experiment.config import Config, check_config
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.config_mistakes import config_mistake
from deepring.experiment.stages import OF_STAGE, stage_folder
from deepring.text import shown


def composed(overrides: Sequence[str]) -> Config:
    """The config of ``deepring train`` with these overrides; nothing runs, nothing is written.

    Raises ConfigError for a mistake in the overrides.
    """
    with in_our_words(overrides):
        return check_config(_compose(["paths.run=.", *overrides]))


def check_training(config: DictConfig, overrides: Sequence[str]) -> Config:
    """The composed config of a training, checked, with the values of each of its stages.

    Each stage is composed as ``stage=NAME`` with the same overrides, and what ``stages.NAME`` has
    differs from that. The keys of training of the run are then those of its last stage.

    Args:
        config: as Hydra composed it.
        overrides: of the run, which it was composed with.

    Raises:
        ConfigError: a value that is missing, or of another type; a dataset that nothing takes; a
            stage that changes a key of the run; ``stage=`` beside ``stages=``.
    """
    cfg = check_config(config)
    if cfg.train_data and cfg.test_data:
        expect_no_data(overrides)
    if not cfg.stages:
        return cfg
    names = list(cfg.stages)
    _expect_no_stage(overrides, names)
    run = Path(cfg.paths.run)
    filled = {
        name: _of_stage(name, values, overrides, stage_folder(run, names, name))
        for name, values in cfg.stages.items()
    }
    for name, staged in filled.items():
        for key in vars(cfg).keys() - {*OF_STAGE, "stages", "evaluate", "paths"}:
            if getattr(staged, key) != getattr(cfg, key):
                raise ConfigError(
                    f"stages: {name} has another {key}, expected a stage that changes only "
                    f"{', '.join(OF_STAGE)}; train it alone with stage={name}"
                )
    of_each = {
        name: {key: getattr(staged, key) for key in OF_STAGE} for name, staged in filled.items()
    }
    last = filled[names[-1]]
    return replace(cfg, **of_each[names[-1]], evaluate=last.evaluate, stages=of_each)


def expect_no_data(overrides: Sequence[str]) -> None:
    """Raise ConfigError for overrides of ``data`` where ``train=`` and ``test=`` name datasets."""
    for text in overrides:
        if _key(text).partition(".")[0] == "data":
            raise ConfigError(
                f"{text}: nothing takes it, since train= and test= name the datasets; give their "
                "folders as paths.roots.NAME=FOLDER, other keys as train_data.NAME.KEY= and "
                "test_data.NAME.KEY="
            )


def _of_stage(name: str, values: Any, overrides: Sequence[str], folder: Path) -> Config:
    """The config of one stage, which writes into ``folder``."""
    beside = [text for text in overrides if not _is_of_stages(text)]
    where = f"stages.{name}"
    if not isinstance(values, dict) or not set(values) <= set(OF_STAGE):
        raise ConfigError(
            f"{where}: {shown(values)}, expected values by name, of {', '.join(OF_STAGE)}"
        )
    try:
        with in_our_words(beside):
            config = _compose([*beside, f"stage={name}"])
            OmegaConf.update(config, "paths.run", str(folder))
            return check_config(OmegaConf.merge(config, values))  # type: ignore[arg-type]
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error


def _compose(overrides: Sequence[str]) -> DictConfig:
    """The config of ``deepring train``, from the places that a running command looks in."""
    register_configs()
    if GlobalHydra.instance().is_initialized():
        return hydra.compose("train", [*overrides])
    with hydra.initialize_config_dir(str(config_folder()), version_base="1.3"):
        return hydra.compose("train", [*overrides])


def _expect_no_stage(overrides: Sequence[str], names: Sequence[str]) -> None:
    for text in overrides:
        if _key(text) == "stage" and not text.startswith("~") and text != "stage=null":
            raise ConfigError(
                f"{text}: beside stages=[{','.join(names)}], expected one of the two; leave "
                "stages= out for that stage alone"
            )


def _is_of_stages(override: str) -> bool:
    return _key(override).partition(".")[0] in ("stage", "stages")


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0].partition("@")[0]


@contextmanager
def in_our_words(arguments: Sequence[str]) -> Iterator[None]:
    """Raise what the config libraries say about a mistake in these arguments as ConfigError."""
    try:
        yield
    except Exception as error:
        mistake = config_mistake(error, [text for text in arguments if not text.startswith("-")])
        if mistake is None:
            raise
        raise ConfigError(mistake) from error
