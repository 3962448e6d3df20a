"""Figures of several methods: precision against recall, and Recall@1 against the radius."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from deepring.errors import DataError
from deepring.evaluation.metrics import Over, area_under, f1_along
from deepring.evaluation.results import Result
from deepring.reports.results_table import recall as recall_of
from deepring.reports.style import FAINT, SMALL_SIZE, legend_below, new_figure, series, style_axes


def precision_recall_figure(
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]], radius: float, title: str = ""
) -> Figure:
    """Precision-recall curves of several methods at one radius, the best F1 of each marked.

    Args:
        curves: (precision, recall) by method, (t,) each on the CPU, the highest threshold first,
            as ``place_precision_recall`` gives them. The legend states AUC and max-F1.
        radius: metres, for the default title.
        title: instead of "Right within ... m".

    Raises:
        DataError: no curve, or precision and recall that are not (t,) of one length t >= 1.
    """
    if not curves:
        raise DataError("curves: none, expected precision and recall of at least one method")
    figure = new_figure(7.2, 4.8 + 0.2 * math.ceil(len(curves) / 2))
    axes = figure.add_subplot()
    _equal_f1_lines(axes)
    for index, (method, (precision, recall)) in enumerate(curves.items()):
        _draw_curve(axes, index, method, np.asarray(precision), np.asarray(recall))
    style_axes(axes, title or f"Right within {radius:g} m", "recall", "precision", grid=False)
    axes.set(xlim=(0, 1.01), ylim=(0, 1.01))
    legend_below(figure, 2, handlelength=1.6, columnspacing=1.2)
    return figure


def recall_radius_figure(
    results: Sequence[Result], over: Over = "answerable", title: str = ""
) -> Figure:
    """Recall@1 against the revisit radius, one line per method.

    Args:
        results: results of one test region, at any radii; a method with several trainings has one
            line per training.
        over: Recall@1 as the share of the answerable queries, or of all.
        title: instead of the test dataset and region.

    Raises:
        DataError: no result, or results of several test regions.
    """
    places = sorted({result.case.place for result in results})
    if len(places) != 1:
        raise DataError(
            f"results: test regions {places}, expected exactly one; draw one figure per region"
        )
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    for index, (label, points) in enumerate(_lines(results, over).items()):
        colour, line, marker = series(index)
        radii, recalls = zip(*sorted(points.items()), strict=True)
        axes.plot(radii, recalls, line, color=colour, marker=marker, markersize=5, label=label)
    style_axes(axes, title or places[0], "revisit radius (m)", f"Recall@1 ({over} queries)")
    axes.set_xticks(sorted({result.radius_m for result in results}))
    axes.set_ylim(0, 1.02)
    axes.legend(loc="best", fontsize=SMALL_SIZE, framealpha=0.94, edgecolor=FAINT)
    return figure


def _draw_curve(
    axes: Axes, index: int, method: str, precision: np.ndarray, recall: np.ndarray
) -> None:
    if precision.ndim != 1 or precision.shape != recall.shape or not precision.size:
        raise DataError(
            f"curves[{method!r}]: precision {precision.shape}, recall {recall.shape}; "
            "expected (t,) each, of one length t >= 1"
        )
    p, r = torch.from_numpy(precision), torch.from_numpy(recall)
    f1 = f1_along(p, r)
    best = int(f1.argmax())
    colour, line, marker = series(index)
    label = f"{method}: AUC {float(area_under(p, r)):.3f}, max F1 {float(f1[best]):.3f}"
    across, up = np.concatenate([[0], recall]), np.concatenate([precision[:1], precision])
    axes.plot(across, up, line, color=colour, linewidth=1.8)
    axes.plot(recall[best], precision[best], marker, color=colour, markersize=6, clip_on=False)
    # an empty line, so that the legend shows the line together with its mark
    axes.plot([], [], line, color=colour, linewidth=1.8, marker=marker, markersize=5, label=label)


def _equal_f1_lines(axes: Axes) -> None:
    for f1 in (0.2, 0.4, 0.6, 0.8):
        recall = np.linspace(f1 / (2 - f1), 1, 100)
        precision = f1 * recall / (2 * recall - f1)
        axes.plot(recall, precision, color=FAINT, linewidth=0.8, zorder=0)
        axes.annotate(
            f"F1 {f1:g}",
            (1.0, precision[-1]),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=SMALL_SIZE - 1,
            color="#8C8C8C",
            annotation_clip=False,
        )


def _lines(results: Sequence[Result], over: Over) -> dict[str, dict[float, float]]:
    trainings = Counter(method for method, _ in {(r.case.method, r.case.train) for r in results})
    lines: dict[str, dict[float, float]] = {}
    for result in results:
        method, train = result.case.method, result.case.train
        label = f"{method} ({train or 'untrained'})" if trainings[method] > 1 else method
        lines.setdefault(label, {})[result.radius_m] = recall_of(result, "recall_1", over)
    return lines
