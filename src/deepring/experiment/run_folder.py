"""The folder of a run: its config, its versions, and the link ``latest`` beside it."""

import json
import logging
import os
import platform
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from importlib import metadata
from io import StringIO
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.utilities import rank_zero_only
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from deepring.errors import ConfigError, DataError, FileError
from deepring.io.files import replacing
from deepring.io.plain_yaml import plain_yaml
from deepring.io.text import read_text
from deepring.io.typed import typed, typed_values

log = logging.getLogger(__name__)

PACKAGES = ("deepring", "torch", "lightning", "hydra-core", "torchmetrics", "numpy", "scipy")


def open_run_folder(record: Mapping[str, Any], folder: Path) -> None:
    """Write ``config.yaml`` and ``versions.json`` into ``folder``.

    ``record`` is what `deepring.experiment.record.record_of` gives. A resumed run leaves both files
    as they are, and adds ``config_resumed_<time>.yaml`` and ``versions_resumed_<time>.json``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    resumed = (folder / "config.yaml").exists()
    suffix = time.strftime("_resumed_%Y-%m-%d_%H-%M-%S") if resumed else ""
    texts = {
        f"config{suffix}.yaml": OmegaConf.to_yaml(OmegaConf.create(dict(record))),
        f"versions{suffix}.json": json.dumps(versions(record["seed"]), indent=2) + "\n",
    }
    for name, text in texts.items():
        with replacing(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def read_config(path: Path) -> dict[str, Any]:
    """The config of a run, as plain values.

    Raises FileError if the file cannot be read, holds no config, or one with values of other types
    than those by which runs are compared.
    """
    text = read_text(path, _CONFIG)
    try:
        # What was recorded is resolved. Another's file must not ask for this machine's variables.
        if "${" in text:
            raise DataError("interpolations")
        plain_yaml(text)
        config = OmegaConf.to_container(OmegaConf.load(StringIO(text)))
    except (DataError, OmegaConfBaseException, YAMLError, ValueError):
        raise FileError(f"{path}: is not YAML of plain values; {_EXPECTED}") from None
    if not isinstance(config, dict) or not config:
        raise FileError(f"{path}: holds a {type(config).__name__}; {_EXPECTED}")
    values = {str(key): value for key, value in config.items()}
    compared = {key: values[key] for key in _COMPARED if key in values}
    try:
        typed_values(_COMPARED, compared, "config")
        typed(Sequence[float] | None, (values.get("evaluation") or {}).get("radii"), _RADII)
    except ConfigError as error:
        raise FileError(f"{path}: {error}; {_EXPECTED}") from None
    return values


_NODE = dict[str, Any] | None
_NODES = dict[str, _NODE] | None

#: The types of what tables and reports look up in a config.
_COMPARED: dict[str, Any] = {
    **dict.fromkeys(("data", "method", "evaluation", "preprocessing"), _NODE),
    **dict.fromkeys(("train_data", "test_data", "methods"), _NODES),
}
_RADII = "config.evaluation.radii"
_CONFIG = "the config of a run; delete that folder to begin it again, or leave it out"
_EXPECTED = f"expected {_CONFIG}"


def is_first_process() -> bool:
    """Whether this process writes: the first of a distributed run, or the only one."""
    return getattr(rank_zero_only, "rank", 0) in (None, 0)


def versions(seed: int) -> dict[str, object]:
    """Versions, seed, git commit and command line of this run."""
    return {
        "started": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "command": " ".join(sys.argv),
        "seed": seed,
        "git_commit": _git_commit(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: metadata.version(name) for name in PACKAGES},
    }


def _git_commit() -> str | None:
    """The checkout's commit, with '+' if it has changes; None outside a checkout."""
    here = Path(__file__).parent
    try:
        commit = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=True
        ).stdout.strip()
        changes = subprocess.run(
            ["git", "status", "--porcelain"], cwd=here, capture_output=True, text=True, check=True
        ).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit + ("+" if changes else "")


class LinkLatest(Callback):
    """Points ``latest`` at a run when its training starts, so that it never names a refused run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:  # noqa: ARG002
        """Link in the first process of a distributed run."""
        if trainer.is_global_zero:
            link_latest(self.folder)


def link_latest(folder: Path) -> None:
    """Point ``latest`` beside ``folder`` at it, in one step.

    A ``latest`` that is a folder, as a copy that follows links leaves it, stays, with a warning.
    """
    latest = folder.parent / "latest"
    if latest.is_dir() and not latest.is_symlink():
        log.warning(
            "%s is a folder, not a link to the newest run, and is left as it is; delete it, and "
            "the next run links it again",
            latest,
        )
        return
    fresh = folder.parent / f".latest-{os.getpid()}"
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(folder.name, target_is_directory=True)
    fresh.replace(latest)
