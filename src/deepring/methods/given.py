"""What callers give to a method: checked in one place, for every method of the package."""

from collections.abc import Callable
from functools import wraps
from typing import Any

from torch import Tensor

from deepring.core.arrays import expect_finite, real_tensor
from deepring.errors import DataError
from deepring.rasters import Raster
from deepring.search.given import given_pair


def given_rasters(raster: Raster, values: Any) -> Tensor:
    """Rasters (b, *raster.shape) of anything like an array of real numbers or truth values.

    Raises DataError for anything else, another shape, fractions where the raster holds whole
    numbers, and numbers that are not finite in float32.
    """
    tensor = real_tensor("rasters", values)
    shape = tuple(tensor.shape)
    if shape[1:] != raster.shape or not shape:
        expected = ", ".join(map(str, raster.shape))
        one = "; give [raster] for a batch of one" if shape == raster.shape else ""
        raise DataError(f"rasters: shape {shape}, expected (n, {expected}){one}")
    if raster.dtype.kind in "iu" and tensor.is_floating_point():
        raise DataError(f"rasters: {tensor.dtype}, expected whole numbers, as {raster.dtype}")
    # Rasters of one's own may hold NaN for what is not known.
    return expect_finite("rasters", tensor) if _is_packaged(raster) else tensor


def _is_packaged(raster: Raster) -> bool:
    return type(raster).__module__.startswith("deepring.")


def check_calls(cls: type) -> None:
    """Let the ``describe`` and ``compare`` that a class defines check what they are given."""
    for name, check in (("describe", _checked_describe), ("compare", _checked_compare)):
        if name in vars(cls):
            setattr(cls, name, check(vars(cls)[name]))


def _checked_describe(describe: Callable[[Any, Tensor], Tensor]) -> Callable[[Any, Any], Tensor]:
    @wraps(describe)
    def checked(self: Any, rasters: Any) -> Tensor:
        return describe(self, given_rasters(self.raster, rasters))

    return checked


def _checked_compare(compare: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(compare)
    def checked(self: Any, queries: Any, database: Any) -> Any:
        return compare(self, *given_pair(queries, database))

    return checked
