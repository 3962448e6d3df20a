"""The case study's curves for whole methods: what a turn and a translation leave of their scores.

Methods compare differently, and their scores have different units. What a motion costs is
therefore told as a share of what separates a scan from another place.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from deepring.methods.method import Method
from deepring.paper.case_study import ErrorRow, error_rows, twin_motions
from deepring.paper.moved_scans import Scan, moved_scores
from deepring.reports.style import INK, LABEL_SIZE, PALETTE, legend_below, new_figure, style_axes

#: Lines of one colour differ in their dashes.
_DASHES = ("-", "--", ":", "-.")


def method_rows(
    name: str,
    method: Method,
    scans: Sequence[Scan],
    ground_z: float,
    columns: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> list[ErrorRow]:
    """Rows of a method as `deepring.paper.case_study.measure` has them of representations.

    An error is the share of what separates a scan from unrelated ones, on average: 0 where the twin
    scores as the scan itself, 1 where it scores as an unrelated scan; NaN where the method does not
    separate them. Arguments and errors are those of `deepring.paper.moved_scans.moved_scores`.
    """
    rng = np.random.default_rng(seed)
    motions = [twin_motions(rng.uniform(0, 360), rng.uniform(0, 2 * math.pi)) for _ in scans]
    scores = moved_scores(method, scans, motions, ground_z, columns, seed, progress)
    unrelated = (scores.own.mean() - scores.others) / scores.gap
    return error_rows(name, scores.lost, unrelated)


def curves_figure(rows: Sequence[ErrorRow], title: str = "") -> Figure:
    """Mean loss of each method against translation and against rotation.

    ``rows`` are those of `method_rows`, of any number of methods; ``title`` is that of the whole
    figure, such as the dataset.
    """
    figure = new_figure(11.0, 5.2)
    panels = {kind: figure.add_subplot(1, 2, k + 1) for k, kind in enumerate(_PANELS)}
    names = list(dict.fromkeys(row.representation for row in rows))
    for number, name in enumerate(names):
        line = _DASHES[number // len(PALETTE) % len(_DASHES)]
        for kind, axes in panels.items():
            points = [(r.value, r.mean) for r in rows if (r.representation, r.kind) == (name, kind)]
            label = name if kind == "translation" else None
            axes.plot(
                *zip(*points, strict=True), line, color=PALETTE[number % len(PALETTE)], label=label
            )
    for kind, axes in panels.items():
        axes.axhline(1.0, color=INK, linewidth=0.8)
        style_axes(axes, *_PANELS[kind])
        axes.set_ylim(-0.05, 1.3)
    panels["rotation"].set_xticks(range(0, 181, 45))
    figure.suptitle(title, fontsize=LABEL_SIZE, color=INK)
    legend_below(figure, 4)
    return figure


_PANELS = {
    "translation": ("Translation, no turn", "translation (m)", "loss (1: an unrelated scan)"),
    "rotation": ("Turn, no translation", "turn (°)", ""),
}
