"""Ablations as figures: Recall@1 of each row with its seeds, and Recall@1 over the ways."""

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deepring.paper.ablation import CLASSES, GROUP, AblationTable, Entry
from deepring.paper.paper_values import OURS, WAYS, components
from deepring.reports.style import INK, PALETTE, legend_below, new_figure, series, style_axes

_MEAN, _SEED, _PAPER = "mean ± sample sd", "one seed", "paper (NCLT)"

#: Seeds stand a little beside their mean, so that neither hides the other: shares of the room
#: between rows and between numbers of ways.
_BELOW, _BESIDE = 0.17, 0.09


def ablation_figure(table: AblationTable) -> Figure:
    """Table IV as Recall@1 over the ways, any other table as one bar a row.

    Shown are the mean, the sample standard deviation, a dot for each seed, and the paper's value
    as a hollow diamond.
    """
    return _ways_figure(table) if table.name == "table4" else _rows_figure(table)


def _rows_figure(table: AblationTable) -> Figure:
    heights = _heights(table.entries)
    figure = new_figure(7.2, 1.7 + 0.42 * (heights[-1] + 1))
    axes = figure.add_subplot()
    for height, entry in zip(heights, table.entries, strict=True):
        ours = GROUP in entry.names and components(entry.row) == OURS
        _draw_row(axes, height, entry, PALETTE[1] if ours else PALETTE[0])
    style_axes(axes, _title(table), "Recall@1", "")
    axes.set_yticks(heights, [_label(entry) for entry in table.entries])
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set(xlim=(0, 1.02), ylim=(heights[-1] + 0.6, -0.6))
    _legend(figure, axes)
    return figure


def _draw_row(axes: Axes, height: float, entry: Entry, colour: str) -> None:
    axes.barh(height, entry.mean, height=0.66, color=colour, alpha=0.25)
    axes.errorbar(
        entry.mean,
        height - _BELOW,
        xerr=entry.deviation,
        fmt="o",
        color=colour,
        markersize=6,
        capsize=3,
        label=_MEAN,
    )
    dots = list(entry.recalls.values())
    _dots(axes, dots, [height + _BELOW] * len(dots))
    if entry.paper is not None:
        _diamonds(axes, [entry.paper], [height])


def _ways_figure(table: AblationTable) -> Figure:
    lines: dict[str, list[Entry]] = {}
    for entry in table.entries:
        lines.setdefault(_label(entry), []).append(entry)
    ways = sorted({_ways(entry) for entry in table.entries})
    beside = _BESIDE * min(after - before for before, after in pairwise(ways)) / len(lines)
    figure = new_figure(6.4, 4.4)
    axes = figure.add_subplot()
    for index, (label, entries) in enumerate(lines.items()):
        # Lines stand beside each other at each number of ways.
        aside = beside * (2 * index - len(lines) + 1)
        _draw_line(axes, index, label, entries, aside, beside)
    # The paper's value once for each number of ways.
    paper = {_ways(entry): entry.paper for entry in table.entries if entry.paper is not None}
    if paper:
        _diamonds(axes, list(paper), list(paper.values()))
    style_axes(axes, _title(table), "ways of an episode", "Recall@1")
    axes.set_xticks(ways)
    axes.set_ylim(_limits(table.entries))
    _legend(figure, axes)
    return figure


def _draw_line(
    axes: Axes, index: int, label: str, entries: Sequence[Entry], aside: float, beside: float
) -> None:
    colour, line, marker = series(index)
    axes.errorbar(
        [_ways(entry) + aside for entry in entries],
        [entry.mean for entry in entries],
        yerr=[entry.deviation or 0.0 for entry in entries],
        fmt=line + marker,
        color=colour,
        markersize=6,
        capsize=3,
        label=f"{label}: {_MEAN}" if label else _MEAN,
    )
    dots = [(_ways(entry), value) for entry in entries for value in entry.recalls.values()]
    across, up = zip(*dots, strict=True)
    _dots(axes, [value + aside + beside for value in across], up, colour)


def _limits(entries: Sequence[Entry]) -> tuple[float, float]:
    """All that is drawn and some room, at least a tenth; ways differ by little."""
    values = [value for entry in entries for value in entry.recalls.values()]
    values += [entry.mean + (entry.deviation or 0) for entry in entries]
    values += [entry.mean - (entry.deviation or 0) for entry in entries]
    values += [entry.paper for entry in entries if entry.paper is not None]
    low, high = min(values), max(values)
    room = max(0.1 * (high - low), 0.05 - (high - low) / 2, 0.01)
    return max(low - room, -0.02), min(high + room, 1.02)


def _heights(entries: Sequence[Entry]) -> list[float]:
    """Height of each row, downwards, with a gap between the paper's groups."""
    heights = [0.0]
    for before, entry in pairwise(entries):
        apart = before.names.get(GROUP) != entry.names.get(GROUP)
        heights.append(heights[-1] + (1.3 if apart else 1.0))
    return heights


def _dots(axes: Axes, across: Sequence[float], up: Sequence[float], colour: str = INK) -> None:
    axes.plot(across, up, "o", color=colour, markersize=3.5, alpha=0.7, label=_SEED, zorder=4)


def _diamonds(axes: Axes, across: Sequence[float], up: Sequence[float]) -> None:
    axes.plot(
        across,
        up,
        "D",
        markerfacecolor="none",
        markeredgecolor=INK,
        markeredgewidth=1.2,
        markersize=8,
        label=_PAPER,
        zorder=5,
    )


def _legend(figure: Figure, axes: Axes) -> None:
    """One legend entry per kind of mark, means first."""
    handles, labels = axes.get_legend_handles_labels()
    kinds = dict(reversed(list(zip(labels, handles, strict=True))))  # the first of a kind stays
    last = [label for label in (_SEED, _PAPER) if label in kinds]
    shown = [*(label for label in reversed(kinds) if label not in last), *last]
    handles = [kinds[label] for label in shown]
    legend_below(figure, 3 if len(shown) == 3 else 2, handles=handles, labels=shown)


def _label(entry: Entry) -> str:
    """Name of a row; further keys stand with their short names before their values."""
    names = {name: text for name, text in entry.names.items() if name not in (GROUP, CLASSES)}
    plain = [text for name, text in names.items() if "." not in name]
    keyed = [f"{_short(name)} {text}" for name, text in names.items() if "." in name]
    return ", ".join([*([" / ".join(plain)] if plain else []), *keyed])


def _short(key: str) -> str:
    """'pool' of 'representation.pool', 'similarity' of 'similarity.kind'."""
    parts = [part for part in key.split(".") if part not in ("kind", "_target_")]
    return parts[-1] if parts else key


def _title(table: AblationTable) -> str:
    """The table's title on lines that a figure is wide enough for."""
    return table.title.replace(": ", "\n", 1)


def _ways(entry: Entry) -> float:
    return float(entry.row.setting[WAYS])
