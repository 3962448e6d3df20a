"""`deepring train -m`: what a sweep's folders are called, and how each of its jobs ended."""

import json
import logging
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from deepring.cli.report import console, is_mistake
from deepring.errors import StoppedError
from deepring.experiment.status import reason

log = logging.getLogger(__name__)

#: Jobs, in whichever process, find here where to say how they ended.
OUTCOMES = "DEEPRING_SWEEP_OUTCOMES"


def is_sweep(arguments: Sequence[str]) -> bool:
    """Whether the arguments ask for a multirun."""
    return any(argument in ("-m", "--multirun") for argument in arguments)


def naming(arguments: Sequence[str], ablations: Path) -> list[str]:
    """A further override, by which a job's folder is named after what is varied alone.

    What an ablation of the folder ``ablations`` varies is a part of the name also where the
    command line gives it one value.
    """
    parser = OverridesParser.create()
    fixed, varied = [], {"seed"}
    for argument in arguments:
        if argument.startswith("-"):
            continue
        try:
            override = parser.parse_override(argument)
        except HydraException:
            continue  # Hydra will say what is wrong
        key = override.get_key_element()
        if key == "ablation" and not override.is_sweep_override():
            varied |= _varied_by(ablations / f"{override.value()}.yaml")
        if not override.is_sweep_override():
            fixed.append(key)
    keys = ",".join(f'"{key}"' for key in fixed if key.lstrip("+~") not in varied)
    return [f"hydra.job.config.override_dirname.exclude_keys=[{keys}]"]


def _varied_by(ablation: Path) -> set[str]:
    """The keys that an ablation file sweeps; none where it is not there, as Hydra will say."""
    if not ablation.is_file():
        return set()
    params = OmegaConf.select(OmegaConf.load(ablation), "hydra.sweeper.params", default={})
    return set(params)


def in_parallel() -> bool:
    """Whether the launcher runs several jobs at once, so that bars would overwrite each other."""
    return not str(HydraConfig.get().launcher["_target_"]).endswith(".BasicLauncher")


class FreshOutcomes(Callback):
    """Makes the folder that this sweep's jobs write their outcomes to, empty."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Called in the process that starts the jobs, whose environment they inherit."""
        folder = Path(config.hydra.sweep.dir).resolve() / ".outcomes"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        os.environ[OUTCOMES] = str(folder)


@contextmanager
def outcome_noted() -> Iterator[None]:
    """Note how the block, a job of the sweep, ended; an error is logged and goes no further."""
    hydra = HydraConfig.get()
    name, number = hydra.job.override_dirname, hydra.job.num
    _speak_as(name)
    outcome = {"name": name, "folder": hydra.runtime.output_dir, "error": None}
    try:
        yield
    except StoppedError as error:
        raise KeyboardInterrupt from error  # ends the sweep, where an error would not
    except Exception as error:
        outcome["error"] = reason(error)
        log.error("failed: %s", error, exc_info=not is_mistake(error))
    (Path(os.environ[OUTCOMES]) / f"{number:04d}.json").write_text(json.dumps(outcome))


def _speak_as(name: str) -> None:
    """Put the job's name before its log lines, since several jobs may speak at once."""
    for handler in logging.getLogger().handlers:
        handler.setFormatter(logging.Formatter(f"[%(asctime)s] {name}: %(message)s", "%H:%M:%S"))


def report_sweep() -> None:
    """Say how many jobs finished, which failed and why; exit with 1 where one failed."""
    folder = Path(os.environ[OUTCOMES])
    outcomes = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    failed = [outcome for outcome in outcomes if outcome["error"] is not None]
    console.print(f"sweep        {len(outcomes) - len(failed)} of {len(outcomes)} jobs finished")
    for outcome in failed:
        print(f"failed       {outcome['name']}: {outcome['error']}", file=sys.stderr)
    place = folder.parent
    shown = place.relative_to(Path.cwd()) if place.is_relative_to(Path.cwd()) else place
    if any((Path(outcome["folder"]) / "results.csv").is_file() for outcome in outcomes):
        console.print(f"tables       deepring tables {shown}")
    console.print(f"tensorboard  tensorboard --logdir {shown}")
    if failed:
        console.print("the same command goes on with what is left")
        sys.exit(1)
