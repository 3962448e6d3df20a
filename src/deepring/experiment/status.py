"""``status.json``: how far a run has come, so that a sweep knows what is left to do."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, get_args

from filelock import FileLock, Timeout

from deepring.errors import DeepringError, StoppedError
from deepring.io.files import replacing

State = Literal["running", "finished", "failed"]


@dataclass(frozen=True)
class Status:
    """How far a run has come. One that was killed still says 'running'."""

    state: State
    error: str | None = None
    """Why it failed."""
    score: float | None = None
    """Validation Recall@1 of the checkpoint that was kept; None without validation."""
    seconds: float | None = None
    """Training time; None where nothing was trained."""


def read_status(folder: Path) -> Status | None:
    """The status of a run folder, None where it holds none.

    Raises DeepringError where ``status.json`` cannot be read.
    """
    path = folder / "status.json"
    try:
        return _checked(Status(**json.loads(path.read_text())))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError) as error:
        raise DeepringError(
            f"{path}: {error}; expected the status of a run; delete the file to run it again"
        ) from None


def _checked(status: Status) -> Status:
    if status.state not in get_args(State):
        raise ValueError(f"state {status.state!r}, expected one of {', '.join(get_args(State))}")
    numbers = {"score": status.score, "seconds": status.seconds}
    if not isinstance(status.error, str | None):
        raise TypeError(f"error {status.error!r}; expected text")
    for name, value in numbers.items():
        if not isinstance(value, float | int | None):
            raise TypeError(f"{name} {value!r}; expected a number")
    return status


def write_status(folder: Path, status: Status) -> None:
    """Write ``status.json``, in one step."""
    with replacing(folder / "status.json") as temporary:
        temporary.write_text(json.dumps(asdict(status), indent=2) + "\n")


@contextmanager
def failure_noted(folder: Path) -> Iterator[None]:
    """Leave 'failed' and the reason in the run folder where the block raises an error."""
    try:
        yield
    except StoppedError:
        raise
    except Exception as error:
        write_status(folder, Status("failed", error=reason(error)))
        raise


def reason(error: Exception) -> str:
    """An error in words; for one that is not ours, its type too."""
    return str(error) if isinstance(error, DeepringError) else f"{type(error).__name__}: {error}"


@contextmanager
def sole_worker(folder: Path) -> Iterator[None]:
    """Hold the run folder's lock, which the system drops with the process.

    Raises DeepringError where another process holds it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", blocking=False):
            yield
    except Timeout:
        raise DeepringError(
            f"{folder}: another process is working on this run; wait for it, or end it"
        ) from None
