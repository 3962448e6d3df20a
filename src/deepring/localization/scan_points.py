"""Points that a caller gives, as the array that everything here computes with."""

from typing import Any

from deepring.core.arrays import real_array
from deepring.data.scans.returns import scan_from
from deepring.data.session import Points
from deepring.errors import DataError

#: More columns than any sensor's records have: such an array has its points in columns.
WIDEST = 32


def scan_points(name: str, points: Any) -> Points:
    """The points (n, 3) float32 of a scan, without missing returns (`deepring.data.scans.returns`).

    ``points`` is anything like an array of real numbers (n, 3) or wider, x, y and z first: an
    array, a tensor, nested lists. Masked points of a masked array are missing returns.

    Raises DataError, naming ``name``, for everything else, and BrokenScanError if no point is left.
    """
    array = real_array(name, points)
    if array.ndim != 2 or not 3 <= array.shape[1] <= WIDEST:
        turned = array.ndim == 2 and array.shape[0] == 3 and array.shape[1] > WIDEST
        raise DataError(
            f"{name}: shape {array.shape}, expected (n, 3), a row for each point"
            + (": give its transpose" if turned else "")
        )
    return scan_from(array[:, :3], name).points
