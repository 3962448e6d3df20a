"""The places of a map from above, with the paths along them and marks among them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from deepring.reports.round_origin import axis_label, round_origin
from deepring.reports.style import DATABASE, INK, MISS, legend_below, new_figure, style_axes

Positions = NDArray[np.float64]

#: Width in inches: on a telephone the texts can still be read.
WIDTH = 5.4


class Marks(NamedTuple):
    """Positions of one kind."""

    label: str
    positions: Positions
    """(n, 2) metres in the map's world."""
    colour: str
    marker: str


def places_figure(
    places: Positions,
    paths: Sequence[Positions] = (),
    marks: Sequence[Marks] = (),
    errors: Sequence[tuple[Positions, Positions]] = (),
) -> Figure:
    """The places of a map, and what was found among them.

    Args:
        places: (n, 2) metres.
        paths: (m, 2) that were driven.
        marks: of other things, drawn above each other in this order.
        errors: pairs of positions (2,), found and true, that a line joins.
    """
    every = [places, *paths, *(one.positions for one in marks)]
    shown = np.concatenate([*every, np.reshape(list(errors), (-1, 2))])
    origin = round_origin(shown) if len(shown) else np.zeros(2)
    extent = np.ptp(shown, axis=0) if len(shown) else np.zeros(2)
    shape = float(np.clip(extent[1] / max(extent[0], 1e-9), 0.4, 1.3))
    figure = new_figure(WIDTH, WIDTH * shape + 1.2)
    axes = figure.add_subplot()
    for number, path in enumerate(paths):
        label = "_" if number else "path"
        axes.plot(*(path - origin).T, color=INK, linewidth=0.8, alpha=0.6, label=label)
    colour = INK if not marks else DATABASE
    x, y = (places - origin).T
    axes.scatter(x, y, s=12, color=colour, linewidths=0, label=f"places ({len(places)})")
    if errors:
        lines = LineCollection([np.stack(pair) - origin for pair in errors], colors=MISS)
        lines.set(linewidth=0.8, label="to the true position")
        axes.add_collection(lines)
    for name, positions, tone, marker in marks:
        x, y = (positions - origin).T
        label = f"{name} ({len(positions)})"
        crossed = marker in "x+"
        axes.scatter(
            x, y, s=34 if crossed else 22, marker=marker, color=tone, label=label, alpha=0.9,
            linewidths=1.6 if crossed else 0,
        )  # fmt: skip
    x_label, y_label = (axis_label(*pair) for pair in zip("xy", origin, strict=True))
    style_axes(axes, "", x_label, y_label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    legend_below(figure, 2)
    return figure
