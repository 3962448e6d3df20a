"""Missing returns: records of beams that nothing reflected. One rule for every format."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.errors import BrokenScanError


class Scan(NamedTuple):
    """One scan, and how many of its records are missing returns."""

    points: NDArray[np.float32]
    """(n, 3) float32, metres, finite and not (0, 0, 0); n is at least 1. Further columns follow."""
    missing: int
    """Records that are NaN, infinite or (0, 0, 0), which ``points`` leaves out."""


def is_return(records: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Mask (n,) of the records (n, 3) that are points: all finite, and not all zero.

    Sensors and file formats write a beam without a return as NaN, infinity or (0, 0, 0).
    """
    with np.errstate(invalid="ignore"):  # signalling NaN
        x, y, z = np.abs(records.T)
        largest = np.maximum(np.maximum(x, y), z)  # NaN if one of them is
        mask: NDArray[np.bool_] = (largest > 0) & (largest < np.inf)
    return mask


def scan_from(records: NDArray[np.floating], source: Path | str) -> Scan:
    """The points of the records (n, >=3) of one scan, without missing returns, which are counted.

    Raises BrokenScanError naming ``source`` if no point is left.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32 becomes infinite
        values = np.asarray(records, dtype=np.float32)
    valid = is_return(values[:, :3])
    missing = len(values) - int(np.count_nonzero(valid))
    if missing == len(values):
        raise BrokenScanError(
            f"{source}: {len(values)} records, all missing returns (0, 0, 0), NaN or infinite; "
            "expected at least one valid point"
            if missing
            else f"{source}: no points; expected at least one"
        )
    return Scan(np.ascontiguousarray(values[valid] if missing else values), missing)
