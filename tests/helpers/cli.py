"""`deepring` as a user types it: in this process, which is quick, or in one of its own."""

import contextlib
import io
import logging
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

from deepring import progress
from deepring.cli.main import main, parse, run
from helpers.small_training import EPISODES, TINY_DATA

#: The installed command.
DEEPRING = str(Path(sys.executable).with_name("deepring"))

#: A training of one episode on the tiny streets.
SMALL = (
    *(*EPISODES, *TINY_DATA, "sampling.per_epoch=1"),
    *("trainer.max_epochs=1", "trainer.log_every_n_steps=1"),
)

Done = subprocess.CompletedProcess


def deepring(*arguments, cwd, encoding="utf-8", columns=120) -> Done:
    """Run a command in this process: its exit status, output and errors.

    Both are written in ``encoding``, and read in it as the test's text.
    """
    words = [str(argument) for argument in arguments]
    streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="") for _ in range(2)]
    out, errors = streams
    with (
        as_new_process(cwd, columns),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(errors),
    ):
        try:
            main(words)
            status = 0
        except SystemExit as stopped:
            status = stopped.code or 0
    texts = []
    for stream in streams:
        stream.flush()
        texts.append(stream.buffer.getvalue().decode(encoding))
    done = Done(words, status, *texts)
    assert "Traceback" not in done.stderr + done.stdout
    return done


def deepring_process(*arguments, cwd) -> Done:
    """Run the installed command in a process of its own; no traceback may ever show."""
    done = subprocess.run(
        [DEEPRING, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "120"},
        check=False,
    )
    assert "Traceback" not in done.stderr + done.stdout
    return done


def work_of(*arguments):
    """Do a command's work without its error printing, so that the error itself can be tested."""
    return run(parse([str(argument) for argument in arguments]))


def refused(done, *words):
    """It failed, and said why in so many words on standard error."""
    assert done.returncode != 0
    for word in words:
        assert word in done.stderr
    return done


@contextlib.contextmanager
def as_new_process(cwd, columns=120) -> Iterator[None]:
    """Put everything back that a command changes in its process: as if it had ended."""
    environment, arguments, before = dict(os.environ), sys.argv, progress._silent
    progress.silence()  # whether a stage says how far it is depends on the time that it takes
    with contextlib.chdir(cwd), warnings.catch_warnings(), _logging_restored():
        os.environ["COLUMNS"] = str(columns)
        try:
            yield
        finally:
            os.environ.clear()
            os.environ.update(environment)
            sys.argv = arguments
            progress._silent = before
            _forget_hydra()


@contextlib.contextmanager
def _logging_restored() -> Iterator[None]:
    """Hydra sets handlers and levels of the root logger, Lightning a level of its own."""
    loggers = [logging.getLogger(), *map(logging.getLogger, ("lightning.pytorch", "hydra"))]
    before = [(logger, logger.handlers[:], logger.level) for logger in loggers]
    try:
        yield
    finally:
        for logger, handlers, level in before:
            for handler in set(logger.handlers) - set(handlers):
                handler.close()
            logger.handlers[:] = handlers
            logger.setLevel(level)
        logging.disable(logging.NOTSET)


def _forget_hydra() -> None:
    if "hydra" not in sys.modules:
        return
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.hydra_config import HydraConfig

    GlobalHydra.instance().clear()
    HydraConfig.instance().cfg = None
