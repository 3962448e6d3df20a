"""The callbacks of a config, and what they wait for."""

from collections.abc import Mapping, Sequence
from typing import Any

from lightning.pytorch.callbacks import LearningRateMonitor

from deepring.errors import ConfigError
from deepring.experiment.config import Config
from deepring.experiment.objects import class_of

#: Metrics of each validation set.
_METRICS = ("recall@1", "auc")


def check_callbacks(cfg: Config, validation: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The nodes of the callbacks, by name.

    Raises ConfigError for one that is no node, or waits for what is not logged.
    """
    nodes = callback_nodes(cfg)
    _check_monitors(nodes, validation)
    return nodes


def callback_nodes(cfg: Config) -> dict[str, dict[str, Any]]:
    """The nodes of the callbacks, by name. Raises ConfigError that names one which is no node.

    Without a logger, a monitor of the learning rate has nothing to do, and is left out.
    """
    nodes = {}
    for name, node in cfg.callbacks.items():
        if node is None:
            continue
        cls = class_of(node, f"callbacks.{name}")
        if cfg.logger is None and issubclass(cls, LearningRateMonitor):
            continue
        nodes[name] = dict(node)
    return nodes


def _check_monitors(nodes: Mapping[str, Mapping[str, Any]], validation: Sequence[str]) -> None:
    """Raise ConfigError for a callback that waits for a value which is never logged.

    A scheme of one's own may log more of its training than is known here.
    """
    known = ["val/recall@1", *(f"val/{n}/{kind}" for n in validation for kind in _METRICS)]
    for name, node in nodes.items():
        monitor = node.get("monitor")
        if validation and monitor not in (None, *known) and not str(monitor).startswith("train/"):
            raise ConfigError(
                f"callbacks.{name}.monitor: {monitor!r}, expected one of {', '.join(known)}, or "
                "train/loss"
            )
