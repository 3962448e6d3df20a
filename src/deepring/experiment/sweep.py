"""One job of a sweep, which is skipped if it has finished and resumed if it was killed."""

import logging
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from deepring.errors import ConfigError
from deepring.experiment.config import Config
from deepring.experiment.record import record_of
from deepring.experiment.run_folder import read_config
from deepring.experiment.stages import last_checkpoint
from deepring.experiment.status import note_failure, read_status, sole_worker
from deepring.experiment.train import train
from deepring.paper.flat import INDIFFERENT, flatten

log = logging.getLogger(__name__)

#: Keys that may differ between a run and its resumption.
_INDIFFERENT = re.compile(INDIFFERENT)


def run_job(cfg: Config, folder: Path) -> float | None:
    """Train in ``folder`` unless that run has finished, and return its validation score.

    A run with checkpoints is resumed from the last one. Raises ConfigError if the folder holds a
    run of another config, which is left as it is, and DataError if another process works on it.
    """
    _check_alone(cfg.trainer)
    with sole_worker(folder):
        config = folder / "config.yaml"
        if config.is_file():
            _check_same(record_of(cfg), config)
        status = read_status(folder)
        if status is not None and status.state == "finished":
            log.info("finished before: skipped")
            return status.score
        last = last_checkpoint(folder)
        if last is not None:
            log.info("going on from %s", last)
            cfg = replace(cfg, resume=str(last))
        with note_failure(folder):
            return train(cfg, folder, latest=False).score


def _check_alone(trainer: Mapping[str, Any]) -> None:
    devices, nodes = trainer["devices"], trainer["num_nodes"]
    if (devices, nodes) != (1, 1):
        raise ConfigError(
            f"trainer.devices: {devices}, trainer.num_nodes: {nodes}; a sweep gives each job one "
            "device: expected 1 and 1 with -m; train a single run on several without -m"
        )


def _check_same(record: Mapping[str, Any], path: Path) -> None:
    """Raise ConfigError if the folder's config is another one."""
    before, now = flatten(read_config(path)), flatten(record)
    keys = sorted(
        key
        for key in before.keys() | now.keys()
        if not _INDIFFERENT.fullmatch(key) and before.get(key) != now.get(key)
    )
    if keys:
        changes = "; ".join(f"{key}: {before.get(key)}, now {now.get(key)}" for key in keys[:5])
        more = f"; and {len(keys) - 5} more" if len(keys) > 5 else ""
        raise ConfigError(
            f"{path.parent} holds a run of another config: {changes}{more}; give this sweep "
            "another name with sweep_name=NAME, or delete that folder"
        )
