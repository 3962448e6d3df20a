"""How many located scans are off by how much, as a small plot."""

import numpy as np
from numpy.typing import NDArray

from deepring.localization.calibration import LocalizationTrials
from deepring.reports import svg
from deepring.reports.ground_frame import WIDTH
from deepring.reports.marks import bar_legend, legend

#: Errors up to here are drawn by their size, metres; the last bar holds all larger ones.
_LARGEST, _BARS = 5.0, 20

_HEIGHT = 210


def errors_plot(trials: LocalizationTrials, trusted: NDArray[np.bool_]) -> str:
    """The scans by their distance to the true position, those that are trusted (n,) below."""
    edges = np.linspace(0, _LARGEST + _LARGEST / _BARS, _BARS + 2)
    metres = np.minimum(trials.metres, edges[-2])  # the larger ones fall into the last bar
    parts = {"trusted": trusted, "doubtful": ~trusted}
    counts = {kind: np.histogram(metres[of], edges)[0] for kind, of in parts.items()}
    highest = int(np.sum(list(counts.values()), axis=0).max())
    ticks = [tick for tick in svg.round_ticks(0, max(highest, 1), 6) if tick == round(tick)]
    whole = np.arange(_LARGEST)
    names = [*(f"{metre:g}" for metre in whole), f"> {_LARGEST:g}"]
    middle = (edges[-2] + edges[-1]) / 2  # of the last bar
    across = svg.Axis(
        "distance to the true position (m)", 0.0, float(edges[-1]), [*whole, middle], names
    )
    plot = svg.Plot(across, svg.Axis("scans", 0.0, 1.05 * highest, ticks), WIDTH, _HEIGHT)
    marks, below = [], np.zeros(len(edges) - 1, dtype=np.int64)
    for kind, heights in counts.items():
        for number in np.flatnonzero(heights):
            low, high = float(edges[number]), float(edges[number + 1])
            reach = f"{low:g} to {high:g} m" if number < _BARS else f"more than {low:g} m"
            told = f"{reach}: {heights[number]} {kind}"
            foot = int(below[number])
            marks.append(plot.bar((low, high), (foot, foot + int(heights[number])), kind, told))
        below += heights
    entries = [bar_legend(kind, f"{kind} ({int(of.sum())})") for kind, of in parts.items()]
    return legend(entries) + plot.drawn(marks, "Scans by their distance to the true position")
