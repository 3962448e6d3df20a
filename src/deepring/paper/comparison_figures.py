"""The paper's precision-recall figure: a panel a test, a colour a method, a line a seed."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from deepring.errors import DeepringError
from deepring.reports.style import INK, LABEL_SIZE, SMALL_SIZE, new_figure, series, style_axes

#: Panels beside each other.
_ACROSS = 2


def comparison_figure(
    panels: Mapping[str, Mapping[str, Sequence[tuple[ArrayLike, ArrayLike]]]], radius: float
) -> Figure:
    """Precision against recall of several methods in several tests, a thin line a seed.

    Args:
        panels: title to method to a (precision, recall) a seed, (t,) each on the CPU, the highest
            threshold first, as ``place_precision_recall`` gives them. The methods that come first
            are drawn below the others.
        radius: metres within which a retrieval is right, named in the figure's title.

    Raises:
        DeepringError: no panel, one without a curve, or precision and recall that are not (t,) of
            one length t >= 1.
    """
    if not panels:
        raise DeepringError("panels: none given; expected at least one with a curve a method")
    methods = list(dict.fromkeys(method for panel in panels.values() for method in panel))
    across = min(len(panels), _ACROSS)
    down = math.ceil(len(panels) / across)
    figure = new_figure(5.0 * across, 4.2 * down + 0.3 * math.ceil((len(methods) + 1) / 4))
    for number, (title, curves) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(down, across, number)
        _draw_panel(axes, title, curves, methods)
    _legend(figure, methods)
    title = f"Right within {radius:g} m, a line a seed"
    figure.suptitle(title, fontsize=LABEL_SIZE, color=INK)
    return figure


def _draw_panel(
    axes: Axes,
    title: str,
    curves: Mapping[str, Sequence[tuple[ArrayLike, ArrayLike]]],
    methods: Sequence[str],
) -> None:
    if not any(curves.values()):
        raise DeepringError(f"panels[{title!r}]: no curve; expected at least one; leave it out")
    for method, of_seeds in curves.items():
        colour, line, _ = series(methods.index(method))
        for number, (precision, recall) in enumerate(of_seeds):
            up, across = np.asarray(precision), np.asarray(recall)
            if up.ndim != 1 or up.shape != across.shape or not up.size:
                raise DeepringError(
                    f"panels[{title!r}][{method!r}][{number}]: precision {up.shape}, recall "
                    f"{across.shape}; expected (t,) each, of one length t >= 1"
                )
            # begun at recall 0 with the first precision, as the area under it
            axes.plot(
                np.concatenate([[0], across]),
                np.concatenate([up[:1], up]),
                line,
                color=colour,
                linewidth=0.9,
                alpha=0.85,
                zorder=2 + 0.01 * methods.index(method),
            )
    style_axes(axes, title, "recall", "precision")
    axes.set(xlim=(0, 1.01), ylim=(0, 1.01))


def _legend(figure: Figure, methods: Sequence[str]) -> None:
    axes = figure.axes[0]
    for number, method in enumerate(methods):
        colour, line, _ = series(number)
        # an empty line, thick enough to tell its colour
        axes.plot([], [], line, color=colour, linewidth=2.2, label=method)
    figure.legend(
        loc="outside lower center",
        ncols=min(len(methods), 4),
        fontsize=SMALL_SIZE,
        frameon=False,
    )
