"""Points and lines in the world, for a viewer in three dimensions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]

GREY, BLUE, ORANGE, GREEN, RED, PURPLE = (
    (150, 150, 150),
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (213, 94, 0),
    (204, 121, 167),
)


def on_screen(points: float) -> float:
    """A radius in points of the screen, the same from near and far; negative, as rerun has it."""
    return -points


@dataclass(frozen=True, eq=False)
class Points:
    """Points of one colour or of a colour each."""

    path: str
    """Where it stands in the viewer's tree, such as ``map/places``."""
    positions: NDArray[np.float64]
    """(n, 3) metres in the world."""
    colour: Colour | NDArray[np.uint8]
    radius: float
    """Metres, or `on_screen`."""
    labels: Sequence[str] = ()
    """A text for each point, or none."""
    step: int | None = None
    """The scan at which it appears; None for what is always there."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Polylines of one colour."""

    path: str
    strips: Sequence[NDArray[np.float64]]
    """Each (n, 3) metres in the world."""
    colour: Colour
    radius: float
    """Metres, or `on_screen`."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What a viewer shows."""

    name: str
    shapes: Sequence[Points | Lines]
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """(3,) metres that the viewer's coordinates are relative to: it has float32 alone, which in UTM
    would step by half a metre."""
