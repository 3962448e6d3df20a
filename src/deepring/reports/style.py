"""The style of all figures: colours, text sizes, axes, and files.

Figures are matplotlib ``Figure`` objects on the Agg canvas. Nothing here opens a window or has
global state, so that figures work without a display and in several threads.
"""

import io
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from deepring.io.files import replacing

#: Okabe and Ito's colours, which the colour-blind can distinguish, without the faint yellow.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4D4D4D")
LINES = ("-", "--", ":")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

HIT, MISS, UNANSWERABLE, DATABASE = "#009E73", "#D55E00", "#6A88A8", "#C4C4C4"
INK, FAINT = "#262626", "#D9D9D9"

TITLE_SIZE, LABEL_SIZE, SMALL_SIZE = 12.0, 10.5, 9.0  # points


def new_figure(width: float, height: float) -> Figure:
    """An empty white figure of this size in inches, with an automatic layout."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def series(index: int) -> tuple[str, str, str]:
    """Colour, line style and marker of the ``index``-th series; distinct even without colour."""
    return (
        PALETTE[index % len(PALETTE)],
        LINES[index // len(PALETTE) % len(LINES)],
        MARKERS[index % len(MARKERS)],
    )


def style_axes(axes: Axes, title: str, across: str, up: str, *, grid: bool = True) -> None:
    """Set title and labels, light ticks, and a frame of only the left and lower edge."""
    axes.set_title(title, fontsize=TITLE_SIZE, color=INK, loc="left", pad=9)
    axes.set_xlabel(across, fontsize=LABEL_SIZE, color=INK)
    axes.set_ylabel(up, fontsize=LABEL_SIZE, color=INK)
    axes.tick_params(labelsize=SMALL_SIZE, colors=INK, color=FAINT, length=3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#8C8C8C")
    if grid:
        axes.grid(color=FAINT, linewidth=0.6)
        axes.set_axisbelow(True)


def legend_below(figure: Figure, columns: int, **options: Any) -> None:
    """What the marks mean, below all axes, in as many columns as fit, at most ``columns``.

    ``options`` are those of ``Figure.legend``.
    """
    options |= {"fontsize": SMALL_SIZE, "frameon": False, "loc": "outside lower center"}
    for number in range(columns, 0, -1):
        legend = figure.legend(ncols=number, **options)
        if number == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def without_formulas(figure: Figure) -> Figure:
    """The figure, with what stands between dollar signs drawn as it is written.

    Names come from files; matplotlib would take such text for a formula, and refuse what is none.
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            axis.get_ticklabels(which="both")  # makes them
    for text in figure.findobj(Text):
        text.set_parse_math(False)
    return figure


def png(figure: Figure, dpi: float = 150.0) -> bytes:
    """The figure as the bytes of a PNG file."""
    buffer = io.BytesIO()
    without_formulas(figure).savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def save(figure: Figure, path: str | Path, dpi: float = 150.0) -> None:
    """Write a PNG in one step, creating folders.

    Raises FileError if the file cannot be written.
    """
    with replacing(path) as temporary:
        without_formulas(figure).savefig(temporary, format="png", dpi=dpi)
