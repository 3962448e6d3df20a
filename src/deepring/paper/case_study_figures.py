"""The case study: a scan and its moved twin in SG and PG; the error of all against the motion."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure

from deepring.errors import DataError
from deepring.paper.case_study import NAMES, ROWS, ErrorRow, Kind, TwinPair, View
from deepring.reports.sinograms import draw_bev
from deepring.reports.style import INK, LABEL_SIZE, PALETTE, legend_below, new_figure, style_axes

_ANGLES = (0, 90, 180, 270, 360)
_TITLES: dict[str, str] = {"SG": "Sinogram (SG)", "PG": "Polar gram (PG)"}
_ACROSS: dict[str, str] = {"SG": "τ (m)", "PG": "r (m)"}
_COLOURS: dict[str, str] = dict(zip(NAMES, PALETTE, strict=False))


def pair_figure(pair: TwinPair) -> Figure:
    """Scan and twin from above; one row per representation: both images, magnitudes, difference.

    Magnitudes and difference of a row share one colour scale, whose steps are finer near zero,
    since the mean of the rows (ω = 0) outshines the rest.
    """
    figure = new_figure(15.0, 3.0 * len(pair.views))
    grid = figure.add_gridspec(len(pair.views), 6, width_ratios=(1.0, *[0.86] * 5))
    axes = [[figure.add_subplot(grid[i, j]) for j in range(6)] for i in range(len(pair.views))]
    metres = float(np.hypot(*pair.motion.shift))
    moved = f"Turned {pair.motion.yaw_deg % 360:.0f}°, moved {metres:.0f} m"
    for (left, *right), bev, title, view in zip(
        axes, pair.bevs, ("Scan", moved), pair.views, strict=True
    ):
        draw_bev(left, bev, title, pair.extent)
        _draw_view(right, view, pair.extent)
    return figure


def _draw_view(axes: Sequence[Axes], view: View, extent: float) -> None:
    name = view.name
    box = (-extent if name == "SG" else 0.0, extent, 360.0, 0.0)
    top = float(view.images.max())  # one scale, so that they compare
    pictures = zip(view.images, (_TITLES[name], f"{name}, moved"), strict=True)
    for panel, (image, title) in zip(axes, pictures, strict=False):
        panel.imshow(image, cmap="magma", vmin=0, vmax=top, extent=box, aspect="auto")
        _dress_image(panel, title, _ACROSS[name])
    box = (0.0, view.difference.shape[1], 360.0, 0.0)
    norm = PowerNorm(0.5, vmin=0, vmax=float(view.magnitudes.max()))
    titles = (f"{name}, DFT magnitude", "moved, rows aligned", f"difference: {view.error:.1%}")
    shown = (*view.magnitudes, view.difference)
    for panel, image, title in zip(axes[2:], shown, titles, strict=True):
        panel.imshow(image, cmap="viridis", norm=norm, extent=box, aspect="auto")
        _dress_image(panel, title, "ω")
    axes[0].set_ylabel("θ (°)", fontsize=LABEL_SIZE, color=INK)


def _dress_image(axes: Axes, title: str, across: str) -> None:
    style_axes(axes, title, across, "", grid=False)
    axes.set_box_aspect(1)
    axes.set_yticks(_ANGLES)


def error_figure(rows: Sequence[ErrorRow], title: str = "") -> Figure:
    """Relative error against translation and against rotation: mean and inter-quartile band.

    Turns by whole rows of θ and turns that end between two rows are separate lines; unrelated
    scans, where there are any, are a level a representation.

    Args:
        rows: as ``measure`` gives them.
        title: of the whole figure, such as the dataset.

    Raises:
        DataError: no rows of a translation or of a rotation.
    """
    figure = new_figure(10.0, 4.6)
    shifted, turned = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    for name, colour in _COLOURS.items():
        _draw_line(shifted, _of(rows, name, "translation"), colour, f"{name}, mean and quartiles")
        turns = _of(rows, name, "rotation")
        _draw_line(turned, [row for row in turns if _is_whole(row)], colour)
        between = [row for row in turns if not _is_whole(row)]
        _draw_line(turned, between, colour, f"{name}, turn ends between two rows", ":")
    _draw_unrelated((shifted, turned), rows)
    style_axes(
        shifted, "Translation, no turn", "translation (m)", "relative error of the magnitudes"
    )
    style_axes(turned, "Turn, no translation", "turn (°)", "")
    shifted.set_xticks(range(0, 21, 5))
    turned.set_xticks(range(0, 181, 45))
    top = max(axes.get_ylim()[1] for axes in (shifted, turned))
    for axes in (shifted, turned):
        axes.set_ylim(0, top)
    figure.suptitle(title, fontsize=LABEL_SIZE, color=INK)
    legend_below(figure, 3)
    return figure


def _of(rows: Sequence[ErrorRow], name: str, kind: Kind) -> list[ErrorRow]:
    selection = [row for row in rows if (row.representation, row.kind) == (name, kind)]
    if not selection:
        raise DataError(f"rows: none of {name} and kind {kind!r}; expected those of measure()")
    return selection


def _is_whole(row: ErrorRow) -> bool:
    return row.value is not None and (row.value * ROWS / 360).is_integer()


def _draw_line(
    axes: Axes, rows: Sequence[ErrorRow], colour: str, label: str = "", line: str = "-"
) -> None:
    values = np.array([row.value for row in rows], dtype=float)
    mean, low, high = ([getattr(row, key) for row in rows] for key in ("mean", "q25", "q75"))
    axes.fill_between(values, low, high, color=colour, alpha=0.18, linewidth=0)
    # markers at the turns, since nothing is known of those in between
    marker = "o" if rows[0].kind == "rotation" else ""
    axes.plot(values, mean, line, color=colour, linewidth=1.8, marker=marker, markersize=3)
    if label:
        axes.plot([], [], line, color=colour, linewidth=1.8, label=label)


def _draw_unrelated(panels: Sequence[Axes], rows: Sequence[ErrorRow]) -> None:
    for row in rows:
        if row.kind == "unrelated":
            colour = _COLOURS[row.representation]
            for axes in panels:
                axes.axhline(row.mean, color=colour, linestyle="--", linewidth=1.2)
            label = f"{row.representation}, unrelated scans, mean"
            panels[0].plot([], [], "--", color=colour, linewidth=1.2, label=label)
