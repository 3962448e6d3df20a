"""A drive from above: its trajectories, and the loops among its keyframes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deepring.localization.drives.drive_result import DriveResult
from deepring.reports.round_origin import axis_label, round_origin
from deepring.reports.style import (
    DATABASE,
    HIT,
    MISS,
    PALETTE,
    legend_below,
    new_figure,
    style_axes,
)

_TRUTH, _BEFORE, _AFTER = DATABASE, PALETTE[4], PALETTE[0]


def drive_figure(result: DriveResult) -> Figure:
    """Trajectory before and, if there is one, after optimisation, each in a panel, with the loops.

    Loops are lines between keyframes: accepted ones green, rejected ones red. Where the truth is
    known it lies below, and trajectories are aligned with it. No line leads across a break of the
    odometry.
    """
    drawn = {name: poses[:, :2, 3] for name, poses in result.aligned().items()}
    every = np.concatenate(list(drawn.values()))
    origin, extent = round_origin(every), np.ptp(every, axis=0)
    shape = float(np.clip(extent[1] / max(extent[0], 1e-9), 0.4, 1.4))
    width = 6.4 if len(drawn) == 1 else 5.6
    figure = new_figure(width * len(drawn), width * shape + 1.3)
    panels = figure.subplots(1, len(drawn), squeeze=False)[0]
    for axes, (name, positions) in zip(panels, drawn.items(), strict=True):
        _draw(axes, name, positions - origin, result, origin, legend=axes is panels[-1])
    legend_below(figure, 3)
    return figure


def _draw(
    axes: Axes,
    name: str,
    positions: NDArray[np.float64],
    result: DriveResult,
    origin: NDArray[np.float64],
    *,
    legend: bool,
) -> None:
    """One trajectory (n, 2) and its loops, relative to the origin (2,)."""

    def label(text: str) -> str:
        return text if legend else "_"

    if result.truth is not None:
        x, y = (result.truth.poses[result.truth.known][:, :2, 3] - origin).T
        axes.plot(x, y, color=_TRUTH, linewidth=4, label=label("true poses"))
    colour = _AFTER if name == "optimized" else _BEFORE
    keyframes = positions[result.graph.scans]
    for k, part in enumerate(result.parts(positions)):
        name_once = label("trajectory") if k == 0 else "_"
        axes.plot(*part.T, color=colour, linewidth=1.2, label=name_once)
    if result.graph.breaks:
        lost = keyframes[list(result.graph.breaks)].T
        axes.plot(*lost, "D", color=MISS, markersize=6, label=label("odometry lost"))
    for loops, tone, words in (
        (result.kept, HIT, "loops"),
        (result.rejected, MISS, "loops rejected"),
    ):
        pairs = [keyframes[[loop.earlier, loop.keyframe]] for loop in loops]
        if pairs:
            lines = LineCollection(pairs, colors=tone, linewidths=1.0, alpha=0.8)
            lines.set_label(label(f"{words} ({len(pairs)})"))
            axes.add_collection(lines)
    axes.plot(*positions[0], "o", color="black", markersize=5, label=label("start"))
    title = {"odometry": "before", "optimized": "optimised"}[name]
    style_axes(axes, title, axis_label("x", origin[0]), axis_label("y", origin[1]))
    axes.set_aspect("equal", adjustable="datalim")
