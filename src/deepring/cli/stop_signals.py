"""SIGTERM ends a command as Ctrl-C does: it says how to go on, and its processes end with it."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Exit status after Ctrl-C, and after SIGTERM, as shells have them.
INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM

_received: list[int] = []


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Within the block SIGTERM raises KeyboardInterrupt, where it would end the process at once.

    Slurm, systemd and CI end a job with it. A process that was forked from this one still ends at
    once, and a signal that the caller ignores or handles is left to the caller.
    """
    _received.clear()
    before = signal.getsignal(signal.SIGTERM)
    if before is not signal.SIG_DFL or threading.current_thread() is not threading.main_thread():
        yield
        return
    process = os.getpid()

    def interrupt(number: int, _frame: FrameType | None) -> None:
        if os.getpid() != process:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        _received.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def stop_status() -> int:
    """The exit status of an interrupted command: `TERMINATED` after SIGTERM, else `INTERRUPTED`."""
    return TERMINATED if _received else INTERRUPTED
