"""The places of a map from above, with the paths along them and marks among them."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.reports import svg
from deepring.reports.ground_frame import Frame
from deepring.reports.marks import legend, line_legend, mark_legend, marks

Positions = NDArray[np.float64]


class Marked(NamedTuple):
    """Positions of one kind."""

    label: str
    positions: Positions
    """(n, 2) metres in the map's world."""
    kind: str
    """Of `deepring.reports.marks.SHAPES`."""


def places_drawing(
    places: Positions,
    paths: Sequence[Positions] = (),
    marked: Sequence[Marked] = (),
    errors: Sequence[tuple[Positions, Positions]] = (),
) -> str:
    """The places of a map, and what was found among them, with a legend.

    Args:
        places: (n, 2) metres, at least one.
        paths: (m, 2) that were driven.
        marked: other things, drawn above each other in this order.
        errors: pairs of positions (2,), found and true, that a line joins.
    """
    every = [places, *paths, *(one.positions for one in marked)]
    frame = Frame(np.concatenate([*every, np.reshape(list(errors), (-1, 2))]))
    kind = "place" if marked else "place alone"
    parts = [
        frame.lines(paths, "driven"),
        svg.dots(map(frame.at, places), kind),
        frame.lines(errors, "off"),
        *(marks(map(frame.at, one.positions), one.kind) for one in marked),
    ]
    entries = list(_entries(len(places), kind, paths, marked, errors))
    described = ", ".join(words for _, words in entries)
    return legend(entries) + frame.drawn(parts, ("x", "y"), described, "map")


def _entries(
    places: int,
    kind: str,
    paths: Sequence[Positions],
    marked: Sequence[Marked],
    errors: Sequence[tuple[Positions, Positions]],
) -> Iterator[tuple[str, str]]:
    if paths:
        yield line_legend("driven", "path")
    yield mark_legend(kind, f"places ({places})")
    for one in marked:
        yield mark_legend(one.kind, f"{one.label} ({len(one.positions)})")
    if errors:
        yield line_legend("off", "to the true position")
