"""The method of a run, for a report: a registered network of its checkpoint, or one that learns
nothing. The classes that its config names are imported only if they are the package's own."""

from pathlib import Path

from deepring.errors import ConfigError
from deepring.experiment import build
from deepring.experiment.config import Config
from deepring.methods.method import Method
from deepring.methods.network_file import SHIPPED, load_network
from deepring.methods.registry import packaged_methods


def run_method(run: Path, cfg: Config, name: str) -> Method:
    """The method of this name in the run's results.

    Raises DeepringError, which says why, where there is no checkpoint or it is of a class that is
    not registered.
    """
    for node in (cfg.method, *cfg.methods.values()):
        packaged = node and node.get("_target_") in packaged_methods().values()
        if packaged and node.get("label") == name and not build.learns(node):
            return build.method(node)
    checkpoint = checkpoint_of(run, cfg)
    if checkpoint is None:
        raise ConfigError(
            f"the run holds no checkpoint of {name}, expected checkpoints/best.ckpt or last.ckpt"
        )
    network = load_network(checkpoint).method
    if network.settings.label != name:
        raise ConfigError(f"{checkpoint}: {network.settings.label}, expected {name}")
    return network


def checkpoint_of(run: Path, cfg: Config) -> Path | None:
    """The configured checkpoint, else the run's own."""
    own = [run / "checkpoints" / name for name in ("best.ckpt", "last.ckpt")]
    configured = [] if cfg.checkpoint is None else [Path(cfg.checkpoint)]
    return next((c for c in (*configured, *own) if c.is_file() or str(c) == SHIPPED), None)
