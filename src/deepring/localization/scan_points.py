"""Points that a caller gives, as the array that everything here computes with."""

from numbers import Real
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

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


def real_array(name: str, values: Any) -> NDArray[Any]:
    """An array of real numbers like ``values``; masked ones are NaN.

    Raises DataError for anything else: complex numbers, truth values, text, objects, fields.
    """
    try:
        array = _array(values)
    except MemoryError:
        raise
    except Exception as error:  # any object may be given, and raise anything
        raise _unlike(name, f"a {type(values).__name__}") from error
    if array.dtype.kind == "O" and all(_is_real(value) for value in array.flat):
        try:
            array = array.astype(np.float64)
        except (OverflowError, TypeError, ValueError) as error:
            raise DataError(f"{name}: a number beyond float64, expected metres") from error
    if array.dtype.kind not in "fiu":
        raise _unlike(name, f"an array of {array.dtype}, shape {array.shape}")
    return array


def _array(values: Any) -> NDArray[Any]:
    if isinstance(values, torch.Tensor):
        values = values.detach().cpu()
        return (values.float() if values.dtype is torch.bfloat16 else values).numpy()
    if isinstance(values, np.ma.MaskedArray):
        numbers = values.dtype.kind in "fiu"
        return np.where(values.mask, np.nan, values.data) if numbers else values.data
    return np.asarray(values)


def _is_real(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def _unlike(name: str, what: str) -> DataError:
    return DataError(f"{name}: {what}, expected an array of real numbers")
