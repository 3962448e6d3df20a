"""`deepring train -m`: what a sweep's folders are called, and how each of its jobs ended."""

import hashlib
import json
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from deepring.cli.console import INTERRUPTED, console, is_mistake
from deepring.errors import DeepringError, StoppedError
from deepring.experiment.status import reason
from deepring.io.files import replacing

log = logging.getLogger(__name__)

#: Jobs, in whichever process, find here where to say how they ended.
OUTCOMES = "DEEPRING_SWEEP_OUTCOMES"

#: What a job's outcome says until it ends.
KILLED = "its process was killed, perhaps for want of memory"

#: How often a job is begun in one sweep, where processes are killed.
ATTEMPTS = 3

#: Options of Hydra that show something instead of running jobs.
_MODES = ("--cfg", "-c", "--info", "-i", "--resolve", "--package", "--run", "-r")


def is_sweep(arguments: Sequence[str]) -> bool:
    """Whether the arguments ask for a multirun. Raises DeepringError where for more than that."""
    asked = any(argument in ("-m", "--multirun") for argument in arguments)
    other = [argument for argument in arguments if argument.partition("=")[0] in _MODES]
    if asked and other:
        raise DeepringError(f"-m: given with {other[0]}, which shows one config; leave one out")
    return asked


#: The group whose files say what a sweep varies.
_SWEEPING = "sweep"


def naming(arguments: Sequence[str], configs: Path) -> list[str]:
    """A further override, by which a job's folder is named after what is varied alone.

    What a file of ``sweep`` in the folder ``configs`` varies is a part of the name also
    where the command line gives it one value; of a key given twice the last one counts, as for
    Hydra.
    """
    parser = OverridesParser.create()
    swept: dict[str, bool] = {}
    varied = {"seed"}
    for argument in arguments:
        if argument.startswith("-"):
            continue
        try:
            override = parser.parse_override(argument)
        except HydraException:
            continue  # Hydra will say what is wrong
        key = override.get_key_element()
        swept[key] = override.is_sweep_override()
        if key == "hydra.sweep.dir" and not override.value():
            raise DeepringError(f"{argument}: expected a folder to keep the sweep in")
        if key == _SWEEPING and not swept[key]:
            varied |= _varied_by(configs / key / f"{override.value()}.yaml")
    fixed = [key for key in swept if not swept[key] and key.lstrip("+~") not in varied]
    keys = ",".join(f'"{key}"' for key in dict.fromkeys(_spellings(fixed)))
    return [f"hydra.job.config.override_dirname.exclude_keys=[{keys}]"]


def _spellings(keys: Sequence[str]) -> Iterator[str]:
    """Hydra drops the + of a key here and there."""
    for key in keys:
        yield from (key, key.lstrip("+~"))


def _varied_by(config: Path) -> set[str]:
    """The keys that a config file sweeps; none where it is not there, as Hydra will say."""
    if not config.is_file():
        return set()
    params = OmegaConf.select(OmegaConf.load(config), "hydra.sweeper.params", default={})
    return set(params)


def folder_name(varied: str) -> str:
    """What is varied as the name of one folder: no slash, neither empty nor too long."""
    name = varied.replace("/", "_") or "run"
    if len(name.encode()) <= 200:
        return name
    return f"{name[:100]}+{hashlib.sha256(varied.encode()).hexdigest()[:12]}"


OmegaConf.register_new_resolver("folder_name", folder_name, replace=True)


class FreshOutcomes(Callback):
    """Makes the folder that this sweep's jobs write their outcomes to."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Called in the process that starts the jobs, whose environment they inherit.

        Hydra turns an error here into a warning; the first job meets and reports it then.
        """
        if OUTCOMES not in os.environ:  # else it is started again, after a process was killed
            sweep = Path(config.hydra.sweep.dir).resolve()
            sweep.mkdir(parents=True, exist_ok=True)
            os.environ[OUTCOMES] = tempfile.mkdtemp(prefix=".outcomes-", dir=sweep)


class Swept(NamedTuple):
    """How the jobs of a sweep ended."""

    finished: list[Path]
    """Folders."""
    failed: list[tuple[Path, str]]
    """Folders, and why."""


def run_sweep(launch: Callable[[], None]) -> Swept:
    """Launch the jobs and tell how they ended; on Ctrl-C say so and exit.

    A killed process takes its whole pool of processes with it, so the jobs are launched again:
    finished ones are skipped, the others go on, and none is begun more than `ATTEMPTS` times.
    """
    os.environ.pop(OUTCOMES, None)
    try:
        while True:
            try:
                launch()
                break
            except BrokenProcessPool:
                begun = [outcome for outcome in _outcomes() if outcome["error"] == KILLED]
                if all(outcome["attempts"] >= ATTEMPTS for outcome in begun):
                    break
                log.warning("a job's process was killed; launching what is left again")
        return _swept()
    except KeyboardInterrupt:
        report_sweep(_swept())
        print("interrupted; the same command goes on with what is left", file=sys.stderr)
        sys.exit(INTERRUPTED)
    finally:
        shutil.rmtree(os.environ.pop(OUTCOMES, ""), ignore_errors=True)


def _swept() -> Swept:
    ended = [(Path(outcome["folder"]), outcome["error"]) for outcome in _outcomes()]
    return Swept(
        [folder for folder, error in ended if error is None],
        [(folder, error) for folder, error in ended if error is not None],
    )


@contextmanager
def outcome_noted() -> Iterator[None]:
    """Note how the block, a job of the sweep, ended; an error is logged and goes no further.

    Raises DeepringError where it was begun too often.
    """
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    _speak_as(folder.name)
    note = Path(os.environ.get(OUTCOMES, folder.parent)) / f"{hydra.job.num:04d}.json"
    before = json.loads(note.read_text()) if note.is_file() else {"attempts": 0}
    outcome = {"folder": str(folder), "error": KILLED, "attempts": before["attempts"] + 1}
    try:
        if before["attempts"] >= ATTEMPTS:
            raise DeepringError(f"{KILLED}, {ATTEMPTS} times; try fewer hydra.launcher.n_jobs")
        _note(note, outcome)
        yield
    except StoppedError as error:
        outcome["error"] = "interrupted"
        raise KeyboardInterrupt from error  # ends the sweep, where an error would not
    except Exception as error:
        outcome["error"] = reason(error)
        log.error("failed: %s", error, exc_info=not is_mistake(error))
    else:
        outcome["error"] = None
    finally:
        _note(note, outcome)


def _note(path: Path, outcome: dict[str, Any]) -> None:
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(outcome))


def _outcomes() -> list[dict[str, Any]]:
    folder = os.environ.get(OUTCOMES)
    paths = [] if folder is None else sorted(Path(folder).glob("*.json"))
    return [json.loads(path.read_text()) for path in paths]


def in_parallel() -> bool:
    """Whether the launcher runs several jobs at once, so that bars would overwrite each other."""
    return not str(HydraConfig.get().launcher["_target_"]).endswith(".BasicLauncher")


def _speak_as(name: str) -> None:
    """Put the job's name before its log lines, since several jobs may speak at once."""
    safe = name.replace("%", "%%")
    for handler in logging.getLogger().handlers:
        handler.setFormatter(logging.Formatter(f"[%(asctime)s] {safe}: %(message)s", "%H:%M:%S"))


def report_sweep(swept: Swept) -> int:
    """Say how many jobs finished, which failed and why; the number of those that did not finish."""
    finished, failed = swept
    console.print(f"sweep        {len(finished)} of {len(finished) + len(failed)} jobs finished")
    for folder, error in failed:
        print(f"failed       {folder.name}: {error}", file=sys.stderr)
    if finished:
        place = finished[0].parent
        shown = place.relative_to(Path.cwd()) if place.is_relative_to(Path.cwd()) else place
        if any((folder / "results.csv").is_file() for folder in finished):
            console.print(f"tables       deepring tables {shown}")
        console.print(f"tensorboard  tensorboard --logdir {shown}")
    if failed:
        console.print("mend what is said above; the same command then goes on with what is left")
    return len(failed)
