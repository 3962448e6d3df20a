"""A round number that far positions, such as UTM, are shown relative to."""

import numpy as np
from numpy.typing import NDArray

_FAR = 10_000.0  # metres


def round_origin(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The kilometre below the smallest coordinate of each axis, if it lies far from the origin.

    Args:
        positions: (n, d) metres, at least one.

    >>> round_origin(np.array([[345_678.0, 20.0]]))
    array([345000.,      0.])
    """
    lowest = positions.min(axis=0)
    return np.where(np.abs(lowest) < _FAR, 0.0, np.floor(lowest / 1000) * 1000)


def axis_label(name: str, origin: float) -> str:
    """The label of an axis that shows coordinates relative to the origin, metres."""
    if not origin:
        return f"{name} (m)"
    return f"{name} {'−' if origin > 0 else '+'} {abs(origin):,.0f} (m)".replace(",", " ")
