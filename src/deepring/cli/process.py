"""Settings of the process that must be made at its start; docs/performance.md has figures."""

import ctypes
import os

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_POOL_BYTES = 1 << 30


def tune_process() -> None:
    """Make the process faster; call it before torch is imported. Results do not change.

    OpenMP threads sleep while they wait, instead of spinning: beside another program, spinning made
    an episode some six times slower. glibc keeps up to a gigabyte of freed memory for reuse, which
    halves the time of an episode; other C libraries have no such call.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_M_MMAP_THRESHOLD, _POOL_BYTES)
    mallopt(_M_TRIM_THRESHOLD, _POOL_BYTES)
