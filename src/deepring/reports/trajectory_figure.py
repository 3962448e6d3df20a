"""Maps of the queries of a drive: hits, misses and unanswerable queries."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from deepring.errors import DataError
from deepring.reports.round_origin import axis_label, round_origin
from deepring.reports.style import (
    DATABASE,
    HIT,
    MISS,
    UNANSWERABLE,
    legend_below,
    new_figure,
    style_axes,
)


def trajectory_figure(
    database: ArrayLike,
    queries: ArrayLike,
    right: ArrayLike,
    answerable: ArrayLike,
    title: str = "",
    labels: tuple[str, str] = ("x", "y"),
) -> Figure:
    """Map of a drive from above: database places, and each query as hit, miss or unanswerable.

    Args:
        database: (d, 2) metres, across and up.
        queries: (q, 2) metres, in the same frame.
        right: (q,) bool, whether the top-1 place lies within the radius.
        answerable: (q,) bool, whether any database place does.
        title: the figure's title, such as method and radius.
        labels: labels of the two axes; pass ("easting", "northing") for UTM.

    Raises:
        DataError: shapes that do not fit, no query, or positions that are not finite.
    """
    database, queries = _positions("database", database), _positions("queries", queries)
    right, answerable = np.asarray(right, bool), np.asarray(answerable, bool)
    if not len(queries) or right.shape != (len(queries),) or answerable.shape != right.shape:
        raise DataError(
            f"queries {queries.shape}, right {right.shape}, answerable {answerable.shape}: "
            "expected (q, 2), (q,) and (q,) with q >= 1"
        )
    offset = round_origin(np.concatenate([database, queries]))
    width, height = _size(np.ptp(np.concatenate([database, queries]), axis=0))
    figure = new_figure(width, height)
    axes = figure.add_subplot()
    _draw_places(axes, database - offset)
    _draw_queries(axes, queries - offset, right, answerable)
    across, up = (axis_label(*pair) for pair in zip(labels, offset, strict=True))
    style_axes(axes, title, across, up)
    axes.set_aspect("equal", adjustable="datalim")
    axes.xaxis.set_major_locator(MaxNLocator(7))
    axes.yaxis.set_major_locator(MaxNLocator(7))
    legend_below(figure, 4)
    return figure


def _draw_places(axes: Axes, places: NDArray[np.float64]) -> None:
    x, y = places.T
    axes.scatter(x, y, s=30, color=DATABASE, linewidths=0, label=f"map ({len(places)})")


def _draw_queries(
    axes: Axes,
    queries: NDArray[np.float64],
    right: NDArray[np.bool_],
    answerable: NDArray[np.bool_],
) -> None:
    """Draw misses last and as crosses, so that they can be seen even without colour."""
    dots = 34 * float(np.clip(200 / len(queries), 1, 4))  # larger where there are few
    kinds = (
        ("no place in reach", ~answerable, ".", UNANSWERABLE, dots, 0.0),
        ("hit", answerable & right, ".", HIT, dots, 0.0),
        ("miss", answerable & ~right, "x", MISS, 30, 1.6),
    )
    for name, of_kind, marker, colour, size, width in kinds:
        label = f"{name} ({np.count_nonzero(of_kind)})"
        x, y = queries[of_kind].T
        axes.scatter(x, y, s=size, marker=marker, color=colour, linewidths=width, label=label)


def _positions(name: str, values: ArrayLike) -> NDArray[np.float64]:
    positions = np.asarray(values, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.isfinite(positions).all():
        raise DataError(
            f"{name}: shape {positions.shape}, {np.count_nonzero(~np.isfinite(positions))} not "
            "finite; expected finite metres of shape (n, 2)"
        )
    return positions


def _size(extent: NDArray[np.float64]) -> tuple[float, float]:
    """Width and height in inches, at most 6.4 wide: the drive's shape, with title and legend."""
    shape = float(np.clip(extent[1] / max(extent[0], 1e-9), 0.35, 1.6))
    width = 6.4 if shape <= 1 else 5.4
    return width, min(width * shape, 6.4) + 1.1
