"""Regions of the ground plane: unions of discs, half-planes and polygons."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deepring.errors import ConfigError

Positions = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Shape(Protocol):
    """A part of the plane, in ground-truth coordinates."""

    def contains(self, positions: Positions) -> Mask:
        """Mask (n,) of the positions (n, 2) inside."""
        ...


@dataclass(frozen=True)
class Disc:
    """Positions within ``radius`` metres of ``center``."""

    center: tuple[float, float]
    radius: float

    def contains(self, positions: Positions) -> Mask:
        """True for a distance of at most the radius."""
        offset = positions - np.asarray(self.center, dtype=np.float64)
        inside: Mask = np.hypot(offset[:, 0], offset[:, 1]) <= self.radius
        return inside


@dataclass(frozen=True)
class HalfPlane:
    """Positions on the side of ``point`` to which ``normal`` points, the border included."""

    point: tuple[float, float]
    normal: tuple[float, float]

    def contains(self, positions: Positions) -> Mask:
        """True for a non-negative projection on the normal."""
        side: Mask = (positions - np.asarray(self.point)) @ np.asarray(self.normal) >= 0
        return side


@dataclass(frozen=True)
class Polygon:
    """Positions inside a closed polygon of at least three ``vertices``, the border included.

    If the border crosses itself, a position is inside when a ray from it crosses the border an odd
    number of times.
    """

    vertices: tuple[tuple[float, float], ...]

    def contains(self, positions: Positions) -> Mask:
        """Counts crossings of rays along x, relative to a vertex, for the precision of UTM."""
        start = np.asarray(self.vertices, dtype=np.float64)
        start, points = start - start[0], positions[:, None] - start[0]
        end = np.roll(start, -1, axis=0)
        to_start, to_end, edge = start - points, end - points, end - start
        with np.errstate(over="ignore", invalid="ignore"):  # positions may be anywhere
            side = to_end[..., 1] * edge[:, 0] - to_end[..., 0] * edge[:, 1]
            between = (to_start * to_end).sum(axis=-1) <= 0
        # Half-open in y, so that a ray through a vertex crosses one of its two edges.
        straddles = (to_start[..., 1] > 0) != (to_end[..., 1] > 0)
        crosses = straddles & ((side < 0) == (edge[:, 1] > 0))
        border = (side == 0) & between
        inside: Mask = (crosses.sum(axis=1) % 2 == 1) | border.any(axis=1)
        return inside


@dataclass(frozen=True)
class Region:
    """Positions in any shape of ``inside`` (everywhere if empty) and in none of ``outside``."""

    inside: tuple[Shape, ...] = ()
    outside: tuple[Shape, ...] = ()

    def contains(self, positions: Positions) -> Mask:
        """Mask (n,) of the ground-truth positions (n, 2) in the region."""
        mask = np.ones(len(positions), dtype=np.bool_)
        if self.inside:
            mask = np.any([shape.contains(positions) for shape in self.inside], axis=0)
        for shape in self.outside:
            mask &= ~shape.contains(positions)
        return mask


def parse_region(spec: Any, name: str) -> Region:
    """A region from plain config values; None is the whole plane.

    ``spec`` is a list of ``{disc: {center: [x, y], radius: r}}``,
    ``{half_plane: {point: [x, y], normal: [x, y]}}`` and ``{polygon: [[x, y], ...]}``,
    each alone or as ``{outside: SHAPE}``. The region is the union of the plain
    shapes (the whole plane if there are none) without the outside ones. Raises ConfigError, with
    the config key ``name``, for any other value.
    """
    if spec is None:
        return Region()
    if not isinstance(spec, Sequence) or isinstance(spec, str) or not spec:
        raise ConfigError(f"{name}: {spec!r}, expected null or a list of shapes")
    inside, outside = [], []
    for k, item in enumerate(spec):
        where = f"{name}[{k}]"
        if isinstance(item, Mapping) and set(item) == {"outside"}:
            outside.append(_parse_shape(item["outside"], where))
        else:
            inside.append(_parse_shape(item, where))
    return Region(tuple(inside), tuple(outside))


def _parse_shape(spec: Any, name: str) -> Shape:
    try:
        (kind, values), *more = spec.items()
        if more:
            raise ValueError
        match kind:
            case "disc":
                disc = Disc(_pair(values["center"]), float(values["radius"]))
                if set(values) == {"center", "radius"} and 0 < disc.radius < math.inf:
                    return disc
            case "half_plane":
                plane = HalfPlane(_pair(values["point"]), _pair(values["normal"]))
                if set(values) == {"point", "normal"} and any(plane.normal):
                    return plane
            case "polygon":
                polygon = Polygon(tuple(_pair(vertex) for vertex in values))
                if len(polygon.vertices) >= 3:
                    return polygon
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError):
        pass
    raise ConfigError(
        f"{name}: {spec!r}, expected {{disc: {{center: [x, y], radius: r > 0}}}}, "
        "{half_plane: {point: [x, y], normal: [x, y]}}, {polygon: [[x, y], [x, y], [x, y]]}, or "
        "{outside: SHAPE}"
    )


def _pair(values: Any) -> tuple[float, float]:
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise ValueError("not a list")  # the text "12" is not the position (1, 2)
    x, y = (float(value) for value in values)
    if not (np.isfinite(x) and np.isfinite(y)):
        raise ValueError("not finite")
    return x, y
