"""Precision-recall curves of a comparison: which there are, and the figure of them."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from deepring.errors import DataError
from deepring.evaluation.case import Case
from deepring.evaluation.counting import precision_recall
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.reranked_labels import method_label
from deepring.paper.comparison import Block, MethodComparison
from deepring.paper.seed_groups import SeedGroup
from deepring.reports.style import INK, LABEL_SIZE, legend_below, new_figure, series, style_axes

Curve = tuple[ArrayLike, ArrayLike]
"""Precision and recall (t,), the highest threshold first."""

Panels = Mapping[str, Mapping[str, Sequence[Curve]]]
"""Title to method to a curve for each seed."""

_PANELS = {"table1": "in-domain", "table2": "cross-domain"}

#: Panels beside each other.
_ACROSS = 2


def curve_panels(
    comparison: MethodComparison, retrieved: Iterable[tuple[int, TopMatches]]
) -> tuple[Panels, list[str]]:
    """A panel for each test in Tables I and II, a curve for each row and seed.

    Rows with re-ranking are left out: twice as many lines cannot be told apart.

    Args:
        comparison: whose rows and radius are taken.
        retrieved: seed of the run, and what it retrieved in one test; those of a case and seed
            that came before are passed over, as are those that stand in neither table.

    Returns:
        The panels and methods that have any curve, and which rows have none of some of their
        seeds, in words.

    Raises:
        DataError: as `precision_recall`.
    """
    blocks = {
        f"{block[0].case.test}, {_PANELS[name]}": [row for row in block if _first_stage(row)]
        for name, blocks in comparison.blocks.items()
        if name in _PANELS
        for block in blocks
    }
    wanted = {row.case: row for block in blocks.values() for row in block}
    curves: dict[Case, dict[int, Curve]] = {case: {} for case in wanted}
    for seed, matches in retrieved:
        case = matches.case
        if case in wanted and seed in wanted[case].results and seed not in curves[case]:
            beyond = wanted[case].results[seed].wrong_beyond_m
            precision, recall, _ = precision_recall(matches, comparison.radius, beyond)
            curves[case][seed] = precision, recall
    panels = {title: _panel(block, curves) for title, block in blocks.items()}
    lacking = [text for row in wanted.values() for text in _lacking(row, curves[row.case])]
    return {title: panel for title, panel in panels.items() if panel}, lacking


def _first_stage(row: SeedGroup) -> bool:
    return method_label(row.case.method) == row.case.method


def comparison_figure(panels: Panels, radius: float) -> Figure:
    """Precision against recall of several methods in several tests, a thin line a seed.

    Args:
        panels: as `curve_panels` gives them, curves on the CPU. The methods that come first are
            drawn below the others.
        radius: metres within which a retrieval is right, named in the figure's title.

    Raises:
        DataError: no panel, one without a curve, or precision and recall that are not (t,) of
            one length t >= 1.
    """
    if not panels:
        raise DataError("panels: none given; expected at least one, with one curve per method")
    methods = list(dict.fromkeys(method for panel in panels.values() for method in panel))
    across = min(len(panels), _ACROSS)
    down = math.ceil(len(panels) / across)
    figure = new_figure(5.0 * across, 4.2 * down + 0.3 * math.ceil((len(methods) + 1) / 4))
    for number, (title, curves) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(down, across, number)
        _draw_panel(axes, title, curves, methods)
    _legend(figure, methods)
    title = f"Right within {radius:g} m, one line per seed"
    figure.suptitle(title, fontsize=LABEL_SIZE, color=INK)
    return figure


def _panel(block: Block, curves: Mapping[Case, Mapping[int, Curve]]) -> dict[str, list[Curve]]:
    """Method to its curves by seed; the training is named where a method has several."""
    methods = [row.case.method for row in block]
    panel = {}
    for row in block:
        several = methods.count(row.case.method) > 1
        label = f"{row.case.method} ({row.case.train})" if several else row.case.method
        of_seed = curves[row.case]
        if of_seed:
            panel[label] = [of_seed[seed] for seed in sorted(of_seed)]
    return panel


def _lacking(row: SeedGroup, curves: Mapping[int, Curve]) -> list[str]:
    seeds = [str(seed) for seed in row.results if seed not in curves]
    return [f"{row.case}, seed {', '.join(seeds)}"] if seeds else []


def _draw_panel(
    axes: Axes, title: str, curves: Mapping[str, Sequence[Curve]], methods: Sequence[str]
) -> None:
    if not any(curves.values()):
        raise DataError(f"panels[{title!r}]: no curve; expected at least one; leave it out")
    for method, of_seeds in curves.items():
        colour, line, _ = series(methods.index(method))
        for number, (precision, recall) in enumerate(of_seeds):
            up, across = np.asarray(precision), np.asarray(recall)
            if up.ndim != 1 or up.shape != across.shape or not up.size:
                raise DataError(
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
    legend_below(figure, min(len(methods), 4))
