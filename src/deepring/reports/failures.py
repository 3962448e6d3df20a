"""Figures of wrong answers: the query, the retrieved scan and the right one, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from deepring.reports.sinograms import draw_bev, draw_sinogram
from deepring.reports.style import PALETTE, SMALL_SIZE, new_figure, style_axes


@dataclass(frozen=True, eq=False)
class ScanView:
    """One scan of a failure."""

    title: str
    bev: NDArray[np.bool_]
    """(n, n) indexed [x, y]."""
    sinogram: NDArray[np.float32]
    """(θ, τ)."""
    curve: NDArray[np.float32] | None
    """(θ,) correlation with the query over all shifts of θ; None for the query itself."""


def failure_figure(scans: Sequence[ScanView], extent: float, period: float = 360.0) -> Figure:
    """Bird's-eye views, sinograms and correlation curves of a query and of places.

    Args:
        scans: the query first.
        extent: half the side of the images, metres.
        period: degrees that the rows span.
    """
    figure = new_figure(3.1 * len(scans), 7.4)
    grid = figure.add_gridspec(3, len(scans), height_ratios=(3, 2.4, 1.8))
    top = max(float(scan.sinogram.max()) for scan in scans)
    for column, scan in enumerate(scans):
        draw_bev(figure.add_subplot(grid[0, column]), scan.bev, scan.title, extent)
        axes = figure.add_subplot(grid[1, column])
        draw_sinogram(axes, scan.sinogram, "", extent, top, period)
    axes = figure.add_subplot(grid[2, :])
    for number, scan in enumerate(scans[1:], start=1):
        if scan.curve is None:
            continue
        degrees = np.arange(len(scan.curve)) * period / len(scan.curve)
        axes.plot(degrees, scan.curve, color=PALETTE[number], label=scan.title)
    axes.legend(fontsize=SMALL_SIZE, frameon=False)
    style_axes(axes, "", "turn of the points from place to query (°)", "correlation")
    return figure
