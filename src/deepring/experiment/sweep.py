"""One job of a sweep: skipped where it has finished, gone on with where it was killed."""

import logging
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from deepring.errors import DeepringError
from deepring.experiment.config import Config
from deepring.experiment.record import record_of
from deepring.experiment.run_folder import read_config
from deepring.experiment.status import failure_noted, read_status, sole_worker
from deepring.experiment.train import train
from deepring.paper.flat import INDIFFERENT, flatten

log = logging.getLogger(__name__)

#: What may differ between a run and its going on.
_INDIFFERENT = re.compile(INDIFFERENT)


def run_job(cfg: Config, folder: Path) -> float | None:
    """Train in ``folder`` unless that is done; the validation score of what was trained.

    A folder with a checkpoint goes on from the last one. Raises DeepringError where the folder
    holds a run of another config, which is left as it is, and where another process is at it.
    """
    _check_alone(cfg.trainer)
    with sole_worker(folder):
        kept = folder / "config.yaml"
        if kept.is_file():
            _check_same(record_of(cfg), kept)
        status = read_status(folder)
        if status is not None and status.state == "finished":
            log.info("finished before: skipped")
            return status.score
        last = folder / "checkpoints" / "last.ckpt"
        if last.is_file():
            log.info("going on from %s", last)
            cfg = replace(cfg, resume=str(last))
        with failure_noted(folder):
            return train(cfg, folder, latest=False).score


def _check_alone(trainer: Mapping[str, Any]) -> None:
    devices, nodes = trainer["devices"], trainer["num_nodes"]
    if (devices, nodes) != (1, 1):
        raise DeepringError(
            f"trainer.devices: {devices}, trainer.num_nodes: {nodes}; a sweep gives each job one "
            "device: expected 1 and 1 with -m; train a single run on several without -m"
        )


def _check_same(record: Mapping[str, Any], path: Path) -> None:
    """Refuse a folder whose config is another one."""
    before, now = flatten(read_config(path)), flatten(record)
    keys = sorted(
        key
        for key in before.keys() | now.keys()
        if not _INDIFFERENT.fullmatch(key) and before.get(key) != now.get(key)
    )
    if keys:
        changes = "; ".join(f"{key}: {before.get(key)}, now {now.get(key)}" for key in keys[:5])
        more = f"; and {len(keys) - 5} more" if len(keys) > 5 else ""
        raise DeepringError(
            f"{path.parent} holds a run of another config: {changes}{more}; give this sweep a "
            "name of its own with sweep_name=NAME, or delete that folder"
        )
