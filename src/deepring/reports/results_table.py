"""Results as tables, one per test region: for the terminal (rich) and for documents (Markdown)."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.evaluation.case import Case
from deepring.evaluation.intervals import wilson
from deepring.evaluation.metrics import Over
from deepring.evaluation.results import RecallName, Result
from deepring.reports import table as tables
from deepring.reports.table import NONE, Cell, Table, best_bold, rate_text, short_text
from deepring.reports.terminal_table import TerminalTables, terminal


@dataclass(frozen=True)
class _Column:
    """A header, the text of a result, and the function that picks the best number, or None."""

    header: str
    text: Callable[[Result], str]
    best: Callable[[Iterable[float]], float] | None = None


def render(
    results: Sequence[Result], radius: float = 10.0, over: Over = "answerable"
) -> TerminalTables:
    """Tables for the terminal of all results at one radius, two per test region, the best in bold.

    Recalls stand in the first one, each with its 95 % interval, and the rest in the second one.

    Args:
        results: results of any methods, datasets and radii.
        radius: metres; only results at this radius are shown.
        over: Recall@K as the share of the answerable queries, or of all. F1, AUC and AP do not
            depend on it.

    Raises:
        ConfigError: a radius without results, or an unknown ``over``.
    """
    recalls = [*_NAMES, *_recalls(over)]
    rest = [*_NAMES, *_RATES, *_TIMES]
    rows = _rows_at(results, radius)
    pairs = zip(
        _tables(lambda row: _conditions(row, over), recalls, rows),
        _tables(_within, rest, rows),
        strict=True,
    )
    return terminal([table for pair in pairs for table in pair])


def markdown(results: Sequence[Result], radius: float = 10.0, over: Over = "answerable") -> str:
    """``render`` as Markdown, one table per test region, which ends in a newline."""
    columns = [*_NAMES, *_recalls(over), *_RATES, *_TIMES]
    rows = _rows_at(results, radius)
    return tables.markdown(_tables(lambda row: _conditions(row, over), columns, rows))


def render_radii(results: Sequence[Result], over: Over = "answerable") -> TerminalTables:
    """Tables for the terminal of Recall@1, one column per radius; otherwise as ``render``.

    If a method has several results at one radius, the last one counts.
    """
    return terminal(_side_by_side(results, over))


def markdown_radii(results: Sequence[Result], over: Over = "answerable") -> str:
    """``render_radii`` as Markdown, which ends in a newline."""
    return tables.markdown(_side_by_side(results, over))


def recall(result: Result, name: RecallName, over: Over) -> float:
    """A recall of a result over the answerable queries, or over all of them.

    The two differ by the share of the answerable queries, since no other can be answered.
    """
    checks.one_of("over", over, Over)
    checks.one_of("name", name, RecallName)
    value: float = getattr(result, name)
    return share_over(value, result, over)


def share_over(value: float, result: Result, over: Over) -> float:
    """A share of the answerable queries of a result as the share that ``over`` says."""
    return value if over == "answerable" else value * result.answerable / max(result.queries, 1)


def counted(result: Result, over: Over) -> int:
    """The number of queries that a recall is a share of."""
    return result.answerable if over == "answerable" else result.queries


def interval_text(share: float, count: float) -> str:
    """The 95 % interval of a share of ``count`` queries, see `wilson`.

    >>> interval_text(0.862, 65)
    '(.76-.93)'
    """
    return bounds_text(*wilson(share, count))


def bounds_text(low: float, high: float) -> str:
    """The ends of an interval of a share, as `interval_text` writes them."""
    ends = (f"{bound:.2f}".removeprefix("0") for bound in (low, high))
    return f"({'-'.join(ends)})"


def within_text(radius: float, wrong_beyond: float) -> str:
    """When a place is right, and wrong where that is not all the rest.

    >>> within_text(10, 10), within_text(3, 20)
    ('right within 10 m', 'right within 3 m, wrong beyond 20 m')
    """
    within = f"right within {radius:g} m"
    return within if wrong_beyond == radius else f"{within}, wrong beyond {wrong_beyond:g} m"


def _rows_at(results: Sequence[Result], radius: float) -> list[Result]:
    expect_results_at(results, radius)
    return [result for result in results if math.isclose(result.radius_m, radius)]


def expect_results_at(results: Sequence[Result], radius: float) -> None:
    """Raise ConfigError, which names the radii that there are, where none is at this radius."""
    if not any(math.isclose(result.radius_m, radius) for result in results):
        radii = ", ".join(f"{r:g}" for r in sorted({result.radius_m for result in results}))
        raise ConfigError(
            f"radius: {radius:g} m, expected one of {radii or 'none'}, at which there are results; "
            "choose one, or evaluate at this radius"
        )


def _within(result: Result) -> str:
    return within_text(result.radius_m, result.wrong_beyond_m)


def _conditions(result: Result, over: Over) -> str:
    return f"{_within(result)}, recall over {over} queries"


def _recalls(over: Over) -> list[_Column]:
    """The answerable queries, and each recall with its interval."""

    def column(header: str, name: RecallName) -> _Column:
        return _Column(header, lambda result: _with_interval(result, name, over), max)

    return [
        _Column("answerable", lambda result: f"{result.answerable}/{result.queries}"),
        column("R@1", "recall_1"),
        column("R@5", "recall_5"),
        column("R@1%", "recall_1_percent"),
    ]


def _with_interval(result: Result, name: RecallName, over: Over) -> str:
    share = recall(result, name, over)
    return f"{rate_text(share)} {interval_text(share, counted(result, over))}"


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
            return _with_interval(result, "recall_1", over) if result else NONE

        return text

    columns = [*_NAMES, *(_Column(f"{radius:g} m", at(radius), max) for radius in radii)]
    one_per_row = [next(iter(row.values())) for row in rows.values()]
    what = f"Recall@1 over {over} queries, right within"
    return _tables(lambda _: what, columns, one_per_row)


def _tables(
    what: Callable[[Result], str], columns: Sequence[_Column], results: Sequence[Result]
) -> list[Table]:
    """One table per test region and per ``what`` of its results, in their order."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(f"{result.case.place}: {what(result)}", []).append(result)
    headers = [column.header for column in columns]
    return [
        Table(title, headers, _cells(group, columns), len(_NAMES))
        for title, group in groups.items()
    ]


def _cells(group: Sequence[Result], columns: Sequence[_Column]) -> list[list[Cell]]:
    by_column = [
        best_bold([column.text(result) for result in group], column.best) for column in columns
    ]
    return [list(row) for row in zip(*by_column, strict=True)]


_NAMES = (
    _Column("method", lambda result: result.case.method),
    _Column("trained on", lambda result: result.case.trained_on or NONE),
)

_RATES = (
    _Column("max F1", lambda result: rate_text(result.f1_max), max),
    _Column("AUC", lambda result: rate_text(result.auc), max),
    _Column("AP", lambda result: rate_text(result.ap), max),
)

_TIMES = (
    _Column("ms/scan", lambda result: short_text(result.seconds_per_scan * 1e3), min),
    _Column("ms/query", lambda result: short_text(result.seconds_per_query * 1e3), min),
)
