"""What callers give in place of arrays: taken where it is like an array of real numbers."""

from numbers import Real
from typing import Any

import numpy as np
import torch
from jaxtyping import Shaped
from numpy.typing import NDArray
from torch import Tensor

from deepring.errors import DataError


def real_array(name: str, values: Any, *, truth: bool = False) -> NDArray[Any]:
    """An array of real numbers like ``values``; masked ones are NaN.

    Args:
        name: of the values, for messages.
        values: an array, a tensor, nested lists, or anything else that NumPy makes an array of.
        truth: take truth values, too.

    Raises DataError for anything else: complex numbers, text, objects, fields, lists of lists of
    different lengths.
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
            raise DataError(f"{name}: a number beyond float64, expected smaller ones") from error
    if array.dtype.kind not in ("fiub" if truth else "fiu"):
        raise _unlike(name, f"an array of {array.dtype}, shape {array.shape}")
    return array


def real_tensor(name: str, values: Any) -> Shaped[Tensor, "..."]:
    """A tensor of real numbers or truth values like ``values``; a dense one stays as it is.

    Raises DataError as `real_array` does.
    """
    if not isinstance(values, Tensor):
        array = real_array(name, values, truth=True)
        if array.dtype.kind in "iu":
            array = _whole(name, array)
        elif array.dtype.kind == "f" and array.dtype.itemsize > 4:
            array = _float32(array)
        native = array.astype(array.dtype.newbyteorder("="), copy=not array.flags.writeable)
        return torch.from_numpy(np.ascontiguousarray(native))
    if values.layout is not torch.strided or values.is_quantized or values.is_complex():
        raise _unlike(name, f"a tensor of {values.dtype}, {values.layout}")
    return values


def expect_finite(name: str, values: Shaped[Tensor, "..."]) -> Shaped[Tensor, "..."]:
    """The values. Raises DataError where one is NaN, infinite, or beyond float32."""
    if not values.is_floating_point():
        return values
    narrow = values.float() if values.dtype is torch.float64 else values
    finite = torch.isfinite(narrow)
    if not finite.all():
        raise DataError(
            f"{name}: {int((~finite).sum())} of {values.numel()} numbers are NaN, infinite or "
            "beyond float32, expected finite ones"
        )
    return values


def _array(values: Any) -> NDArray[Any]:
    if isinstance(values, Tensor):
        values = values.detach().cpu()
        return (values.float() if values.dtype is torch.bfloat16 else values).numpy()
    if isinstance(values, np.ma.MaskedArray):
        numbers = values.dtype.kind in "fiu"
        return np.where(values.mask, np.nan, values.data) if numbers else values.data
    return np.asarray(values)


def _whole(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Whole numbers in a type that torch has."""
    if array.dtype.kind == "u" and array.dtype.itemsize > 1:
        if array.size and array.max() > np.iinfo(np.int64).max:
            raise DataError(f"{name}: a number beyond int64, expected smaller ones")
        return array.astype(np.int64)
    return array


def _float32(array: NDArray[Any]) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):  # beyond float32 becomes infinite, for `expect_finite`
        return array.astype(np.float32)


def _is_real(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def _unlike(name: str, what: str) -> DataError:
    return DataError(f"{name}: {what}, expected an array of real numbers")
