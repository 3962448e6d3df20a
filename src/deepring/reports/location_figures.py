"""Figures of located scans: one laid over its place, and errors beside the true poses."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deepring.localization.calibration import LocalizationTrials
from deepring.reports.places_figure import WIDTH
from deepring.reports.style import HIT, PALETTE, legend_below, new_figure, style_axes

#: Errors up to here are drawn by their size, metres; the last bar holds all larger ones.
_LARGEST, _BARS = 5.0, 20


def alignment_figure(
    place: NDArray[np.uint8], scan: NDArray[np.float64], extent: float, colour: str
) -> Figure:
    """The cells of a scan (k, 2), metres in the place's frame, over the place's image (n, n)."""
    figure = new_figure(2.9, 2.9)
    axes = figure.add_subplot()
    box = (extent, -extent, -extent, extent)  # as `draw_bev`: x upwards, y to the left
    axes.imshow(
        place[:, ::-1], cmap="Greys", vmax=1.6, origin="lower", extent=box, interpolation="nearest"
    )
    axes.scatter(scan[:, 1], scan[:, 0], s=2.0, color=colour, linewidths=0)
    axes.set(xlim=(extent, -extent), ylim=(-extent, extent))
    style_axes(axes, "", "y, left (m)", "x, forward (m)", grid=False)
    return figure


def errors_figure(trials: LocalizationTrials, trusted: NDArray[np.bool_]) -> Figure:
    """How many scans are off by how much."""
    figure = new_figure(WIDTH, 3.2)
    axes = figure.add_subplot()
    edges = np.linspace(0, _LARGEST + _LARGEST / _BARS, _BARS + 2)
    metres = np.minimum(trials.metres, edges[-2])  # the larger ones fall into the last bar
    parts = ((trusted, "trusted", HIT), (~trusted, "doubtful", PALETTE[4]))
    below = np.zeros(len(edges) - 1)
    for mask, name, colour in parts:
        counts, _ = np.histogram(metres[mask], edges)
        label = f"{name} ({int(mask.sum())})"
        axes.bar(
            edges[:-1], counts, np.diff(edges), below, align="edge", color=colour, label=label,
            edgecolor="white", linewidth=0.5,
        )  # fmt: skip
        below += counts
    style_axes(axes, "", "distance to the true position (m)", "scans")
    ticks = np.arange(0, _LARGEST + 1)
    axes.set_xticks(
        [*ticks[:-1], _LARGEST + _LARGEST / _BARS / 2],
        [*(f"{tick:g}" for tick in ticks[:-1]), f"> {_LARGEST:g}"],
    )
    legend_below(figure, 2)
    return figure
