"""Settings of the process that only its start can make; measured in docs/performance.md."""

import ctypes
import os

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_KEPT_BYTES = 1 << 30


def tune_process() -> None:
    """Call before torch is imported. Speed alone is at stake; results do not change.

    OpenMP threads sleep while they wait, instead of spinning: where another program wants the
    cores, spinning made an episode some six times slower. glibc keeps up to a gigabyte of freed
    memory instead of giving it back and faulting it in again at each step, which halves the time
    of an episode; other C libraries have no such call and are left alone.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_M_MMAP_THRESHOLD, _KEPT_BYTES)
    mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
