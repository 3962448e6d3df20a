"""Results as tables, one per test region: for the terminal (rich) and for documents (Markdown)."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from rich.console import Group

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.evaluation.case import Case
from deepring.evaluation.metrics import Over
from deepring.evaluation.results import Result
from deepring.reports import table as tables
from deepring.reports.table import NONE, Cell, Table, best_bold, rate_text, short_text


@dataclass(frozen=True)
class _Column:
    """A header, the text of a result, and the function that picks the best number, or None."""

    header: str
    text: Callable[[Result], str]
    best: Callable[[Iterable[float]], float] | None = None


def render(results: Sequence[Result], radius: float = 10.0, over: Over = "answerable") -> Group:
    """Tables for the terminal of all results at one radius, one per test region, the best in bold.

    Args:
        results: results of any methods, datasets and radii.
        radius: metres; only results at this radius are shown.
        over: Recall@K as the share of the answerable queries, or of all. F1 and AUC do not
            depend on it.

    Raises:
        ConfigError: a radius without results, or an unknown ``over``.
    """
    return tables.terminal(_headline(results, radius, over))


def markdown(results: Sequence[Result], radius: float = 10.0, over: Over = "answerable") -> str:
    """``render`` as Markdown, which ends in a newline."""
    return tables.markdown(_headline(results, radius, over))


def render_radii(results: Sequence[Result], over: Over = "answerable") -> Group:
    """Tables for the terminal of Recall@1, one column per radius; otherwise as ``render``.

    If a method has several results at one radius, the last one counts.
    """
    return tables.terminal(_side_by_side(results, over))


def markdown_radii(results: Sequence[Result], over: Over = "answerable") -> str:
    """``render_radii`` as Markdown, which ends in a newline."""
    return tables.markdown(_side_by_side(results, over))


def recall(result: Result, k: int, over: Over) -> float:
    """Recall@1 or Recall@5 of a result over the answerable queries, or over all of them.

    The two differ by the share of the answerable queries, since no other can be answered.
    """
    checks.one_of("over", over, Over)
    checks.one_of("k", k, (1, 5))
    value = result.recall_1 if k == 1 else result.recall_5
    return value if over == "answerable" else value * result.answerable / max(result.queries, 1)


def _headline(results: Sequence[Result], radius: float, over: Over) -> list[Table]:
    rows = [result for result in results if math.isclose(result.radius_m, radius)]
    if not rows:
        radii = ", ".join(f"{r:g}" for r in sorted({result.radius_m for result in results}))
        raise ConfigError(
            f"radius: {radius:g} m, expected one of {radii or 'none'}, at which there are results; "
            "choose one, or evaluate at this radius"
        )
    columns = [
        *_NAMES,
        _Column("answerable", lambda result: f"{result.answerable}/{result.queries}"),
        _Column("R@1", lambda result: rate_text(recall(result, 1, over)), max),
        _Column("R@5", lambda result: rate_text(recall(result, 5, over)), max),
        _Column("max F1", lambda result: rate_text(result.f1_max), max),
        _Column("AUC", lambda result: rate_text(result.auc), max),
        _Column("ms/scan", lambda result: short_text(result.seconds_per_scan * 1e3), min),
        _Column("ms/query", lambda result: short_text(result.seconds_per_query * 1e3), min),
    ]
    return _tables(f"right within {radius:g} m, recall over {over} queries", columns, rows)


def _side_by_side(results: Sequence[Result], over: Over) -> list[Table]:
    if not results:
        raise DataError("results: none, expected at least one; run an evaluation first")
    rows: dict[Case, dict[float, Result]] = {}
    for result in results:
        rows.setdefault(result.case, {})[result.radius_m] = result
    radii = sorted({result.radius_m for result in results})

    def at(radius: float) -> Callable[[Result], str]:
        def text(row: Result) -> str:
            result = rows[row.case].get(radius)
            return rate_text(recall(result, 1, over)) if result else NONE

        return text

    columns = [*_NAMES, *(_Column(f"{radius:g} m", at(radius), max) for radius in radii)]
    one_per_row = [next(iter(row.values())) for row in rows.values()]
    return _tables(f"Recall@1 over {over} queries, right within", columns, one_per_row)


def _tables(what: str, columns: Sequence[_Column], results: Sequence[Result]) -> list[Table]:
    """One table per test region, in the order of the results."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.case.place, []).append(result)
    headers = [column.header for column in columns]
    return [
        Table(f"{place}: {what}", headers, _cells(group, columns), len(_NAMES))
        for place, group in groups.items()
    ]


def _cells(group: Sequence[Result], columns: Sequence[_Column]) -> list[list[Cell]]:
    by_column = [
        best_bold([column.text(result) for result in group], column.best) for column in columns
    ]
    return [list(row) for row in zip(*by_column, strict=True)]


_NAMES = (
    _Column("method", lambda result: result.case.method),
    _Column("trained on", lambda result: result.case.train or NONE),
)
