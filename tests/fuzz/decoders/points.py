"""Points of all decoders, and records of fixed length."""

import math
import struct
from collections.abc import Iterable, Sequence

from fuzz.files import UndecodableError

Points = list[list[float]]


def rounded(value: float) -> float:
    """The nearest float32, infinite beyond its range."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def returns(points: Iterable[Sequence[float]]) -> Points:
    """The points that are no missing returns, as float32."""
    kept = []
    for point in points:
        x, y, z = (rounded(value) for value in point)
        if math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and (x or y or z):
            kept.append([x, y, z])
    return some(kept)


def some(points: Points) -> Points:
    """The points. Raises UndecodableError if there are none."""
    if not points:
        raise UndecodableError("no returns")
    return points


def records(content: bytes, layouts: Sequence[str]) -> Points:
    """Records that begin with x, y, z, of the first of `struct`'s layouts that the size allows."""
    whole = [layout for layout in layouts if len(content) % struct.calcsize(layout) == 0]
    if not content or not whole:
        raise UndecodableError("no whole number of records")
    layout = whole[0]
    return returns(values[:3] for values in struct.iter_unpack(layout, content))


def nclt(content: bytes) -> Points:
    """NCLT's records: uint16 x, y, z in steps of 5 mm from -100 m, y to the right and z down."""
    if not content or len(content) % 8:
        raise UndecodableError("no whole number of records")
    hits = struct.iter_unpack("<HHHBB", content)
    # A record of zeros is a missing return, not a point 173 m away.
    return returns(
        (x * 0.005 - 100.0, -(y * 0.005 - 100.0), -(z * 0.005 - 100.0))
        for x, y, z, _, _ in hits
        if x or y or z
    )


def lowered(names: list[str]) -> list[str]:
    """Names of fields, with X, Y and Z in lower case where it is missing."""
    return [
        name.lower() if name in ("X", "Y", "Z") and name.lower() not in names else name
        for name in names
    ]
