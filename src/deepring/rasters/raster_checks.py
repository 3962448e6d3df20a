"""What a raster's values must be, for all kinds of rasters."""

import math
from typing import Any

from deepring.errors import DeepringError


def check_fields(raster: Any, counts: tuple[str, ...], lengths: tuple[str, ...]) -> None:
    """Raise DeepringError where a count is no positive whole number or a length not positive."""
    for name in counts + lengths:
        value = getattr(raster, name)
        whole = isinstance(value, int) and not isinstance(value, bool)
        number = whole or (name in lengths and isinstance(value, float))
        if not number or not 0 < value < math.inf:
            kind = "a whole number" if name in counts else "a length in metres"
            raise DeepringError(f"raster.{name}: {value!r}, expected {kind} above 0")


def check_crop(raster: Any, reach: float) -> None:
    """Raise DeepringError where the preprocessing cuts off what the raster would show."""
    extent = raster.preprocessing.extent
    if extent < reach:
        raise DeepringError(
            f"preprocessing.extent: {extent:g} m, but the {type(raster).__name__} reaches to "
            f"{reach:g} m; expected at least that"
        )
