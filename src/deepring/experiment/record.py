"""What the ``config.yaml`` of a run states."""

from dataclasses import asdict
from typing import Any

from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.methods.network import NetworkMethod, class_path

#: Keys of which nothing is used where nothing is trained.
_OF_TRAINING = ("loss", "sampling", "augmentation", "optimizer", "scheduler", "trained_parts")


def record_of(cfg: Config, network: NetworkMethod | None = None) -> dict[str, Any]:
    """The config as plain values, such that what is recorded is what ran.

    The settings of a checkpoint's ``network`` stand in place of the config's. Of a method that
    learns nothing the keys of training are null.
    """
    values = asdict(cfg)
    if network is not None:
        values["method"] = {"_target_": class_path(network), **network.settings.to_dict()}
    elif cfg.method is not None and not build.learns(cfg.method):
        values |= dict.fromkeys(_OF_TRAINING)
    return values
