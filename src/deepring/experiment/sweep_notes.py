"""What the jobs of a running sweep note of themselves: one file each, in a folder of this start."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deepring import checks
from deepring.errors import DataError, DeepringError
from deepring.experiment.workers import Worker, worker_of
from deepring.io.files import replacing
from deepring.io.strict_json import read_json
from deepring.text import shown

#: The outcome of a job until it ends.
KILLED = "its process was killed, perhaps for lack of memory"

#: The outcome of a job that Ctrl-C ended.
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Note:
    """What is noted of a job."""

    folder: Path
    error: str | None
    """Why it did not finish; `KILLED` until it ends, None if it has finished."""
    attempts: int
    """How often it was begun."""
    worker: Worker | None = None
    """The process that runs it."""
    began: float | None = None
    """When it began, in seconds since 1970."""


def write_note(path: Path, note: Note) -> None:
    """Write a note, in one step."""
    values = {
        "folder": str(note.folder),
        "error": note.error,
        "attempts": note.attempts,
        "worker": None if note.worker is None else vars(note.worker),
        "began": note.began,
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(values), encoding="utf-8")


def read_note(path: Path) -> Note:
    """Read a note. Raises OSError, or DeepringError for a file that holds none."""
    return _parsed(read_json(path.read_text(encoding="utf-8")))


def notes_in(folder: Path) -> list[Note]:
    """The notes in a folder, in the order of the jobs; those that cannot be read are left out.

    A folder that is gone, as when the sweep ends, has none.
    """
    notes = []
    for path in sorted(folder.glob("*.json")):
        with suppress(OSError, DeepringError, ValueError):
            notes.append(read_note(path))
    return notes


def _parsed(values: Any) -> Note:
    if not isinstance(values, Mapping) or not {"folder", "error", "attempts"} <= values.keys():
        raise DataError(f"note: {shown(values)}, expected folder, error and attempts")
    folder, error, began = values["folder"], values["error"], values.get("began")
    if not isinstance(folder, str) or not isinstance(error, str | None):
        raise DataError(f"note: {shown(dict(values))}, expected texts for folder and error")
    if began is not None and not checks.is_number(began):
        raise DataError(f"began: {shown(began)}, expected a number")
    attempts = checks.count("attempts", values["attempts"], 0)
    return Note(Path(folder), error, attempts, worker_of(values.get("worker")), began)
