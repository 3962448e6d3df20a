"""``status.json``: the state of a run, by which a sweep knows what is left to do."""

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from filelock import FileLock, Timeout

from deepring import checks
from deepring.errors import DataError, DeepringError, FileError, StoppedError
from deepring.experiment.json_record import read_record
from deepring.experiment.workers import Worker, worker_of
from deepring.io.files import replacing, text_of
from deepring.text import shown

State = Literal["running", "finished", "failed", "interrupted"]


@dataclass(frozen=True)
class Status:
    """The state of a run. A run that was killed is still 'running', by a worker that is gone."""

    state: State
    error: str | None = None
    """Why it failed."""
    score: float | None = None
    """Validation Recall@1 of the best checkpoint; None without validation."""
    seconds: float | None = None
    """Training time; None without training."""
    took: float | None = None
    """Seconds of work until this was written, those before a resumption included."""
    stage: str | None = None
    """What a running one does."""
    share: float | None = None
    """How much of the training is done, in [0, 1]; None outside it."""
    seen: float | None = None
    """When this was written, in seconds since 1970."""
    worker: Worker | None = None
    """The process that works on it, or worked on it last."""


def read_status(folder: Path) -> Status | None:
    """The status of a run folder, or None.

    Raises FileError if ``status.json`` cannot be read.
    """
    expected = "the status of a run; delete the file to run it again"
    return read_record(folder / "status.json", _parsed, "a status", expected)


def _parsed(values: Any) -> Status:
    return _checked(Status(**values | {"worker": worker_of(values.get("worker"))}))


def is_finished(folder: Path) -> bool:
    """Whether the run of a folder has finished. Raises FileError as `read_status` does."""
    status = read_status(folder)
    return status is not None and status.state == "finished"


def _checked(status: Status) -> Status:
    checks.one_of("state", status.state, State)
    for name in ("error", "stage"):
        if not isinstance(value := getattr(status, name), str | None):
            raise DataError(f"{name}: {shown(value)}, expected text")
    for name in ("score", "seconds", "took", "share", "seen"):
        value = getattr(status, name)
        if value is not None and not checks.is_number(value):
            raise DataError(f"{name}: {shown(value)}, expected a number")
    return status


def write_status(folder: Path, status: Status) -> None:
    """Write ``status.json``, in one step."""
    with replacing(folder / "status.json") as temporary:
        temporary.write_text(json.dumps(asdict(status), indent=2) + "\n", encoding="utf-8")


@contextmanager
def note_failure(folder: Path) -> Iterator[None]:
    """Write how the block ended to the run folder if it raises: failed and why, or interrupted.

    How long was worked on it, by the last note, stays.
    """
    try:
        yield
    except (KeyboardInterrupt, StoppedError):
        _note(folder, Status("interrupted"))
        raise
    except Exception as error:
        _note(folder, Status("failed", error=reason(error)))
        raise


def _note(folder: Path, status: Status) -> None:
    with suppress(FileError):  # the error that ended the run is the one to tell
        before = read_status(folder)
        write_status(folder, replace(status, took=None if before is None else before.took))


def reason(error: Exception) -> str:
    """The message of an error, with its type unless it is ours or the operating system's."""
    if isinstance(error, OSError):
        return text_of(error)
    return str(error) if isinstance(error, DeepringError) else f"{type(error).__name__}: {error}"


@contextmanager
def sole_worker(folder: Path) -> Iterator[None]:
    """Hold the run folder's lock, which the system releases when the process ends.

    Raises DataError if another process holds it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", blocking=False):
            yield
    except Timeout:
        raise DataError(
            f"{folder}: another process is working on this run, expected none; wait for it, or "
            "end it"
        ) from None
