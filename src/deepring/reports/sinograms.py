"""Figures of a scan, its sinogram, the sinogram of its turned twin, and their correlation."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from deepring.errors import DataError
from deepring.reports.style import INK, PALETTE, SMALL_SIZE, new_figure, style_axes


def sinogram_figure(
    bev: ArrayLike,
    sinogram: ArrayLike,
    turned: ArrayLike,
    correlation: ArrayLike,
    extent: float,
    true_turn: float | None = None,
    period: float = 360.0,
) -> Figure:
    """BEV, sinogram, the sinogram of a turned twin, and the correlation over all shifts.

    Only the position of the peak is computed here.

    Args:
        bev: (n, n) indexed [x, y], x forward and y left; drawn as seen from above, x upwards.
        sinogram: (θ, τ) of ``bev``, θ over [0, ``period``) without the end point.
        turned: (θ, τ) of the twin.
        correlation: (θ,) of the twin with the scan, entry k for a shift by +k rows.
        extent: half the side of the BEV, metres; τ runs over [-extent, extent].
        true_turn: counter-clockwise turn of the twin in degrees, marked unless it is None.
        period: degrees that the rows span, 360, or 180 for a sinogram over half a turn.

    Raises:
        DataError: shapes that do not fit.
    """
    bev, sinogram, turned, correlation = map(np.asarray, (bev, sinogram, turned, correlation))
    _check(bev, sinogram, turned, correlation)
    figure = new_figure(10.0, 5.9)
    grid = figure.add_gridspec(2, 3, height_ratios=(3.2, 2.0))
    draw_bev(figure.add_subplot(grid[0, 0]), bev, "Bird's-eye view", extent)
    top = max(float(sinogram.max()), float(turned.max()))  # one scale, so that they compare
    for column, (image, name) in enumerate(
        ((sinogram, "Sinogram"), (turned, "Sinogram of the turned twin")), 1
    ):
        _draw_sinogram(figure.add_subplot(grid[0, column]), image, name, extent, top, period)
    _draw_correlation(figure.add_subplot(grid[1, :]), correlation, true_turn, period)
    return figure


def draw_bev(axes: Axes, bev: NDArray, title: str, extent: float) -> None:
    """A bird's-eye view (n, n) indexed [x, y], as seen from above, x upwards; extent in metres."""
    # columns are y, which grows to the left of a viewer who looks along x
    box = (extent, -extent, -extent, extent)
    axes.imshow(bev[:, ::-1], cmap="Greys", origin="lower", extent=box, interpolation="nearest")
    axes.plot(0, 0, marker="^", color=PALETTE[1], markersize=7)
    style_axes(axes, title, "y, left (m)", "x, forward (m)", grid=False)


def _draw_sinogram(
    axes: Axes, image: NDArray, name: str, extent: float, top: float, period: float
) -> None:
    """A sinogram (θ, τ), θ downwards over ``period`` degrees; ``top`` is the brightest value."""
    box = (-extent, extent, period, 0.0)
    axes.imshow(image, cmap="magma", vmin=0, vmax=top, extent=box, aspect="auto")
    axes.set_box_aspect(1)  # as large as the bird's-eye view
    style_axes(axes, name, "τ (m)", "θ (°)", grid=False)
    axes.set_yticks(np.linspace(0, period, 5))


def _draw_correlation(
    axes: Axes, correlation: NDArray, true_turn: float | None, period: float
) -> None:
    rows = len(correlation)
    peak = int(correlation.argmax())
    angle = period * peak / rows
    # the first value again at the end, since the shift is circular
    degrees, values = np.arange(rows + 1) * period / rows, np.append(correlation, correlation[0])
    axes.plot(degrees, values, color=PALETTE[0], linewidth=1.6)
    style_axes(axes, "Correlation over all shifts", "shift (°)", "correlation")
    if true_turn is not None:
        label = f"true turn {true_turn % period:.1f}°"
        axes.axvline(true_turn % period, color=INK, linestyle="--", linewidth=1.1, label=label)
    label = f"peak {angle:.0f}° ({peak} of {rows} rows)"
    axes.plot(angle, correlation[peak], "o", color=PALETTE[1], markersize=7, label=label)
    axes.set_xlim(0, period)
    axes.set_xticks(np.linspace(0, period, 9))
    axes.margins(y=0.15)
    axes.legend(loc="best", fontsize=SMALL_SIZE, frameon=False)


def _check(bev: NDArray, sinogram: NDArray, turned: NDArray, correlation: NDArray) -> None:
    flat = sinogram.ndim == 2 and bev.ndim == 2 and bev.shape[0] == bev.shape[1]
    if not flat or turned.shape != sinogram.shape or correlation.shape != sinogram.shape[:1]:
        raise DataError(
            f"bev {bev.shape}, sinogram {sinogram.shape}, turned {turned.shape}, correlation "
            f"{correlation.shape}: expected (n, n), (θ, τ), (θ, τ) and (θ,); drop batch axes"
        )
