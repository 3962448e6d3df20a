"""Limits of time and memory for one input, in a process of its own kind.

Memory is limited as address space, so that what is reserved and never touched counts as well.
"""

import ctypes
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_PAGE = resource.getpagesize()
_ARENAS = -8  # M_ARENA_MAX of mallopt


@dataclass(frozen=True)
class Limits:
    """What one input may take."""

    seconds: float = 5.0
    """Of the processor."""
    bytes: int = 256 << 20
    """Beyond what the process had before."""
    bytes_per_byte: int = 32
    """And this many times the size of the files."""

    def memory(self, size: int) -> int:
        """Bytes for files of ``size`` bytes."""
        return self.bytes + self.bytes_per_byte * size


class TimedOut(BaseException):
    """Not an `Exception`, so that no reader takes it for damage."""


def prepare_process() -> None:
    """Let all threads share one heap: each further one would reserve 64 MB of addresses."""
    with suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL(None).mallopt(_ARENAS, 1)


@contextmanager
def limited(limits: Limits, size: int) -> Iterator[None]:
    """Raise TimedOut, and let allocations fail, beyond the limits. In the main thread only.

    Time is that of the processor, which other programs do not lengthen.
    """
    old = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGPROF, _time_is_up)
    most = _address_space() + limits.memory(size)
    if old[1] != resource.RLIM_INFINITY:
        most = min(most, old[1])
    try:
        resource.setrlimit(resource.RLIMIT_AS, (most, old[1]))
        # Again and again, for a reader that swallows even this one.
        signal.setitimer(signal.ITIMER_PROF, limits.seconds, 1.0)
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, old)
        signal.signal(signal.SIGPROF, handler)


def _time_is_up(*_: object) -> None:
    raise TimedOut


def _address_space() -> int:
    try:
        return int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0]) * _PAGE
    except OSError:  # not Linux
        return resource.RLIM_INFINITY // 2 if resource.RLIM_INFINITY > 0 else 1 << 46
