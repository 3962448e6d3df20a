"""Processes that work on runs, and whether they still live, as far as that can be told."""

import os
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deepring import checks
from deepring.errors import DataError
from deepring.text import shown


@dataclass(frozen=True)
class Worker:
    """A process on a machine."""

    machine: str
    """Name of the machine, and of its space of process numbers: containers have their own."""
    process: int
    began: int | None = None
    """When the process began, in ticks of the system's clock, by which one of the same number is
    another process; None where the system does not tell."""

    @classmethod
    def here(cls) -> "Worker":
        """This process."""
        return cls(_machine(), os.getpid(), _began(os.getpid()))

    @property
    def lives(self) -> bool | None:
        """Whether the process still runs; None for one of another machine."""
        if self.machine != _machine():
            return None
        began = _began(self.process)
        try:
            os.kill(self.process, 0)
        except (ProcessLookupError, OverflowError):
            return False
        except OSError:  # of another user, which the system may hide
            return None if began is None else began == self.began
        return self.began is None or began == self.began

    def __str__(self) -> str:
        name = self.machine.partition(" ")[0]
        return f"process {self.process} on {name}" if name else f"process {self.process}"


def worker_of(values: Any) -> Worker | None:
    """A worker as a file holds it, or None. Raises DataError for anything else."""
    if values is None:
        return None
    if not isinstance(values, Mapping) or not {"machine", "process"} <= values.keys():
        raise DataError(f"worker: {shown(values)}, expected machine and process")
    machine, process, began = values["machine"], values["process"], values.get("began")
    if not isinstance(machine, str):
        raise DataError(f"worker.machine: {shown(machine)}, expected text")
    checks.count("worker.process", process, 1)
    if began is not None:
        checks.count("worker.began", began, 0)
    return Worker(machine, process, began)


def _machine() -> str:
    with suppress(OSError):
        return f"{platform.node()} {Path('/proc/self/ns/pid').readlink()}"
    return platform.node()


def _began(process: int) -> int | None:
    """When a process began; None if it has ended or nothing tells."""
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        # The name of the program, in parentheses, may hold blanks and parentheses.
        state, *fields = text.rpartition(")")[2].split()
        return None if state in "ZX" else int(fields[18])
    except (OSError, ValueError, IndexError):
        return None
