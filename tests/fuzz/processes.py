"""Inputs in processes of their own: one that dies, or stays away, is an outcome too."""

import logging
import multiprocessing
import os
import shutil
import signal
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from fuzz.inputs import Bench, Name
from fuzz.limits import Limits, prepare_process
from fuzz.outcomes import CRASH, HANG, Outcome

#: Inputs of one process: it is replaced then, so that what it may have gathered is given back.
_MOST = 250

#: Exit status of a process in which the suite itself fails.
_SUITE_FAILED = 97

Result = tuple[Name, Outcome, str]


def run_all(
    source: str,
    inputs: Sequence[Name],
    folder: Path,
    limits: Limits,
    processes: int = 2,
) -> Iterator[Result]:
    """The outcomes of all inputs, in the order in which they come.

    ``source`` is the module whose ``every_format`` makes the formats.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([source])
    # Whole formats at a time, so that few benches are set up more than once.
    left = [list(inputs[k : k + _MOST]) for k in range(0, len(inputs), _MOST)][::-1]
    workers: dict[Connection, _Worker] = {}
    count = 0
    try:
        while left or workers:
            while left and len(workers) < processes:
                work = _Work(source, left.pop(), folder / f"p{count:04d}", limits)
                worker = _Worker(context, work)
                workers[worker.connection], count = worker, count + 1
            for connection in wait(list(workers), timeout=1.0):
                worker = workers[connection]  # type: ignore[index]
                yield from worker.received()
                if worker.ended:
                    del workers[worker.connection]
            for worker in list(workers.values()):
                if worker.overdue():
                    yield from worker.killed()
                if worker.ended:
                    workers.pop(worker.connection, None)
                    if worker.todo:
                        left.append(worker.todo)
    finally:
        for worker in workers.values():
            worker.end()


@dataclass(frozen=True)
class _Work:
    """What one process does."""

    source: str
    inputs: list[Name]
    folder: Path
    limits: Limits


class _Worker:
    """A process with some inputs."""

    def __init__(self, context: Any, work: _Work) -> None:
        self.connection, theirs = context.Pipe()
        self.todo, self.limits, self.ended = list(work.inputs), work.limits, False
        self.since, self.started = time.monotonic(), False
        self.process = context.Process(target=_do, args=(work, theirs), daemon=True)
        self.process.start()
        theirs.close()

    def received(self) -> Iterator[Result]:
        """What it has sent; if it died, the input that it had begun is what kills it."""
        try:
            while self.connection.poll():
                received = self.connection.recv()
                self.since = time.monotonic()
                self.started = True
                if received is not None:
                    yield self.todo.pop(0), *received
        except (EOFError, OSError):
            self.process.join(5)
            self.ended = True
            code = self.process.exitcode or 0
            if code == _SUITE_FAILED:
                raise RuntimeError(f"{self.todo[0]}: the suite itself failed") from None
            if self.todo:
                how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
                yield self.todo.pop(0), Outcome(CRASH, how), ""

    def overdue(self) -> bool:
        """Whether the present input takes far longer than its limit."""
        # Imports take their time where other programs run.
        most = 10 * self.limits.seconds + (60 if self.started else 300)
        return not self.ended and time.monotonic() - self.since > most

    def killed(self) -> Iterator[Result]:
        """End a process that hangs."""
        self.end()
        yield self.todo.pop(0), Outcome(HANG, "in compiled code"), ""

    def end(self) -> None:
        """Kill the process."""
        self.ended = True
        self.process.kill()
        self.process.join(5)


def _do(work: _Work, out: Connection) -> None:
    prepare_process()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is printed or logged is no outcome
    logging.disable()
    formats = {format.name: format for format in import_module(work.source).every_format()}
    benches: dict[str, Bench] = {}
    try:
        for name in work.inputs:
            if name.format not in benches:
                folder = work.folder / name.format.replace(" ", "_")
                benches[name.format] = Bench(formats[name.format], folder, work.limits)
                out.send(None)
            out.send(benches[name.format].run(name))
    except BaseException:
        traceback.print_exc()
        os._exit(_SUITE_FAILED)
    shutil.rmtree(work.folder)
    out.close()
    os._exit(0)
