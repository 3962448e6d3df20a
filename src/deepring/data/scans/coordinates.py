"""x, y and z among the named fields of a point: which fields they are, and their values."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import ContentError
from deepring.data.session import Points


def coordinate_fields(names: Sequence[str]) -> list[int]:
    """The indices of the fields x, y and z, or X, Y and Z where those are missing.

    Raises ContentError for fields without one of them, or with one of them twice.
    """
    found = []
    for axis in "xyz":
        matches = [k for k, name in enumerate(names) if name == axis]
        matches = matches or [k for k, name in enumerate(names) if name == axis.upper()]
        if len(matches) != 1:
            fields = " ".join(names)[:200] or "none"
            state = f"{axis} twice" if matches else f"no {axis}"
            raise ContentError(f"fields {fields}: {state}, expected x, y and z once each")
        found += matches
    return found


def points_of(columns: Sequence[NDArray[Any]]) -> Points:
    """Points (n, 3) float32 of three columns (n,) of numbers; beyond float32 they are infinite."""
    points = np.empty((len(columns[0]), 3), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for k, column in enumerate(columns):
            points[:, k] = column
    return points


def expect_type(values: NDArray[np.float64], kind: np.dtype) -> NDArray[np.float64]:
    """The values (n,) of a text, unchanged; ContentError if a type of integers cannot hold them."""
    if kind.kind in "iu":
        limits = np.iinfo(kind)
        inside = (values >= limits.min) & (values <= limits.max) & (values == np.rint(values))
        if not inside.all():
            value = values[~inside][0]
            raise ContentError(f"a coordinate {value:g} in a field of type {kind.name}")
    return values
