"""Outcomes of a sweep's jobs; a job whose process was killed is launched again."""

import glob
import logging
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from deepring.errors import DataError, DeepringError, FileError, StoppedError
from deepring.experiment.planned_jobs import planned
from deepring.experiment.status import reason
from deepring.experiment.sweep_lines import begun_line
from deepring.experiment.sweep_notes import (
    INTERRUPTED,
    KILLED,
    Note,
    notes_in,
    read_note,
    write_note,
)
from deepring.experiment.sweep_plan import begin_plan, end_plan, read_plan
from deepring.experiment.workers import Worker

log = logging.getLogger(__name__)

#: The environment variable that tells the jobs of this process, and of those that it starts, where
#: to note their outcomes.
OUTCOMES = "DEEPRING_SWEEP_OUTCOMES"

#: How the folders of outcomes begin; machine and process of the sweep follow.
_PREFIX = ".outcomes-"

#: How often a sweep launches a job whose process is killed.
ATTEMPTS = 3


class OutcomesFolder(Callback):
    """A Hydra callback that makes the folder for the outcomes of this sweep's jobs."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Runs in the process that starts the jobs; they inherit its environment.

        A folder or file that cannot be made is told by the first job, since Hydra would turn an
        error here into a warning.
        """
        if OUTCOMES in os.environ:  # it is started again, after a process was killed
            return
        sweep = Path(config.hydra.sweep.dir).resolve()
        with suppress(OSError, FileError):
            sweep.mkdir(parents=True, exist_ok=True)
            _remove_left(sweep)
            prefix = f"{_PREFIX}{platform.node()}-{os.getpid()}-"
            os.environ[OUTCOMES] = tempfile.mkdtemp(prefix=prefix, dir=sweep)
            self._begin(sweep, config)

    def _begin(self, sweep: Path, config: DictConfig) -> None:
        """Write which jobs are to be done, and say how to look at them."""
        try:
            plan = planned(config)
        except HydraException:  # Hydra will say what is wrong
            return
        plan = begin_plan(sweep, replace(plan, outcomes=Path(os.environ[OUTCOMES]).name))
        log.info("%s", begun_line(sweep, plan))


def _remove_left(sweep: Path) -> None:
    """Remove the folders of outcomes that sweeps of this machine left when they were killed."""
    begin = f"{_PREFIX}{platform.node()}-"
    for folder in sweep.glob(f"{glob.escape(begin)}*"):
        number = folder.name.removeprefix(begin).partition("-")[0]
        if number.isdecimal() and not _is_running(int(number)):
            shutil.rmtree(folder, ignore_errors=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # of another user, or no number of a process
        return True
    return True


class SweepOutcomes(NamedTuple):
    """How the jobs of a sweep ended."""

    finished: list[Path]
    """Folders of the jobs that finished."""
    failed: list[tuple[Path, str]]
    """Folders of the other jobs, and why they did not finish."""
    interrupted: bool = False
    """Whether Ctrl-C ended the sweep."""


def run_sweep(launch: Callable[[], None]) -> SweepOutcomes:
    """Launch the jobs, and return their outcomes.

    A killed process takes its whole pool of processes with it, so the jobs are launched again:
    finished ones are skipped, the others go on, and none is launched more than `ATTEMPTS` times.
    """
    os.environ.pop(OUTCOMES, None)
    try:
        _launch_again(launch)
        return _outcomes()
    except KeyboardInterrupt:
        _note_interrupted()
        return _outcomes()._replace(interrupted=True)
    finally:
        if folder := os.environ.pop(OUTCOMES, ""):
            with suppress(FileError):
                errors = {note.folder.name: note.error for note in notes_in(Path(folder))}
                end_plan(Path(folder).parent, errors)
            shutil.rmtree(folder, ignore_errors=True)


def _launch_again(launch: Callable[[], None]) -> None:
    """Launch until no process is killed, or every killed job has had its attempts."""
    while True:
        try:
            return launch()
        except BrokenProcessPool:
            killed = [note for note in _notes() if note.error == KILLED]
            if all(note.attempts >= ATTEMPTS for note in killed):
                return None
            log.warning("a job's process was killed; launching what is left again")


def _note_interrupted() -> None:
    """Tell the jobs that ended with the sweep from those whose process was killed."""
    folder = os.environ.get(OUTCOMES)
    for path in [] if folder is None else Path(folder).glob("*.json"):
        with suppress(OSError, DeepringError, ValueError):
            note = read_note(path)
            if note.error == KILLED:
                write_note(path, replace(note, error=INTERRUPTED))


def _outcomes() -> SweepOutcomes:
    notes = _notes()
    return SweepOutcomes(
        [note.folder for note in notes if note.error is None],
        [(note.folder, note.error) for note in notes if note.error is not None],
    )


@contextmanager
def note_outcome(is_mistake: Callable[[Exception], bool]) -> Iterator[None]:
    """Note the outcome of the block, one job of the sweep; an error is logged, not raised.

    Args:
        is_mistake: whether an error is the user's; any other is logged with its traceback.

    Raises:
        KeyboardInterrupt: the user stopped the job; this ends the sweep.
    """
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    path = _outcomes_folder(folder.parent) / f"{hydra.job.num:04d}.json"
    attempts = read_note(path).attempts if path.is_file() else 0
    note = Note(folder, KILLED, attempts + 1, Worker.here(), time.time())
    try:
        if attempts >= ATTEMPTS:
            raise DataError(f"{KILLED}, {ATTEMPTS} times; try fewer hydra.launcher.n_jobs")
        write_note(path, note)
        yield
    except StoppedError as error:
        note = replace(note, error=INTERRUPTED)
        raise KeyboardInterrupt from error  # ends the sweep, where an error would not
    except Exception as error:
        note = replace(note, error=reason(error))
        log.error("failed: %s", note.error, exc_info=not is_mistake(error))
    else:
        note = replace(note, error=None)
    finally:
        write_note(path, note)


def _outcomes_folder(sweep: Path) -> Path:
    """Where the jobs of this sweep note their outcomes.

    A launcher's process may have begun with an earlier sweep of the same command, whose folder is
    gone: then the sweep's plan tells.
    """
    of_process = os.environ.get(OUTCOMES, "")
    if Path(of_process).is_dir() and Path(of_process).parent == sweep:
        return Path(of_process)
    plan = read_plan(sweep)
    return sweep if plan is None or plan.outcomes is None else sweep / plan.outcomes


def _notes() -> list[Note]:
    """The notes of this sweep's jobs, in their order."""
    folder = os.environ.get(OUTCOMES)
    return [] if folder is None else notes_in(Path(folder))


def in_parallel() -> bool:
    """Whether the launcher runs several jobs at once, whose progress bars would collide."""
    return not str(HydraConfig.get().launcher["_target_"]).endswith(".BasicLauncher")
