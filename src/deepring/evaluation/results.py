"""Results of evaluations, one per line of a CSV file."""

import csv
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal, get_args

from deepring import checks
from deepring.errors import DataError, DeepringError, FileError
from deepring.evaluation.case import Case
from deepring.evaluation.csv_errors import CSV_ERRORS, csv_reason
from deepring.evaluation.intervals import wilson
from deepring.io.files import replacing
from deepring.io.numbers_as_text import real_number, whole_number
from deepring.text import shown

RecallName = Literal["recall_1", "recall_5", "recall_1_percent"]

#: The recalls of a result.
RECALLS: tuple[RecallName, ...] = get_args(RecallName)


@dataclass(frozen=True)
class Result:
    """Rates and times of one case at one revisit radius: one row of the CSV file.

    Rates lie in [0, 1]; recalls are shares of the answerable queries. The file has the 95 %
    interval of each recall beside it, as `interval` gives it. Raises ConfigError for a value of
    another type or out of its range, and DataError for more answerable queries than queries.
    """

    case: Case
    radius_m: float
    wrong_beyond_m: float  # a best place farther than this is wrong; between: see `counting`
    database: int  # places
    queries: int
    answerable: int  # queries with a database place within the radius
    recall_1: float
    recall_5: float
    recall_1_percent: float  # among the best 1 % of the places
    f1_max: float
    auc: float
    ap: float  # average precision
    seconds_per_scan: float  # from points to descriptor
    seconds_per_query: float  # search of all places that the query is compared with

    def __post_init__(self) -> None:
        checks.positive("radius_m", self.radius_m, "metres")
        checks.at_least("wrong_beyond_m", self.wrong_beyond_m, self.radius_m, "metres")
        for name in _COUNTS:
            checks.count(name, getattr(self, name), 0)
        for name in _RATES:
            checks.share(name, getattr(self, name))
        for name in ("seconds_per_scan", "seconds_per_query"):
            checks.at_least(name, getattr(self, name), 0, "seconds")
        if self.answerable > self.queries:
            raise DataError(
                f"answerable: {self.answerable}, expected at most as many as queries, "
                f"{self.queries}"
            )

    def interval(self, recall: RecallName) -> tuple[float, float]:
        """The 95 % interval of a recall over the answerable queries, see `wilson`."""
        return wilson(getattr(self, recall), self.answerable)


_TEXT = tuple(field.name for field in fields(Case))
_NUMBERS = tuple(field.name for field in fields(Result) if field.name != "case")
_COUNTS = ("database", "queries", "answerable")
_RATES = (*RECALLS, "f1_max", "auc", "ap")
#: The columns of a recall's interval.
_INTERVALS = {name: (f"{name}_low", f"{name}_high") for name in RECALLS}
COLUMNS = _TEXT + tuple(
    column
    for name in _NUMBERS
    for column in (name, *_INTERVALS.get(name, ()))  # type: ignore[call-overload]
)


def write_results(path: str | Path, results: Iterable[Result]) -> None:
    """Write results as CSV (UTF-8, one header line), creating folders as needed.

    The file is replaced in one step, so that nobody reads half of it. Floats are read back exactly.
    Raises FileError if the file cannot be written.
    """
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(map(_row, results))


def result_values(result: Result) -> dict[str, str | float]:
    """A result as its row in the file: the value of each of `COLUMNS`."""
    return dict(zip(COLUMNS, _row(result), strict=True))


def read_results(path: str | Path) -> list[Result]:
    """Read what ``write_results`` wrote; a byte order mark and blank lines are allowed.

    Raises FileError for a file that is missing or not CSV in UTF-8, for another header, and, with
    the line, for a value of the wrong type or range.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            _check_header(path, next(reader, []))
            return [_parse(path, reader.line_num, row) for row in reader if row]
    except CSV_ERRORS as error:
        raise FileError(
            f"results {path}: {csv_reason(error)}; expected the results.csv of a run; run the "
            "evaluation again"
        ) from error


def _check_header(path: Path, header: list[str]) -> None:
    if tuple(header) == COLUMNS:
        return
    missing = [name for name in COLUMNS if name not in header]
    unknown = [name for name in header if name not in COLUMNS]
    raise FileError(
        f"results {path}: header {shown(','.join(header))} (missing {missing}, unknown "
        f"{shown(unknown)}); "
        f"expected {','.join(COLUMNS)!r}; run the evaluation again, or correct the first line"
    )


def _parse(path: Path, line: int, row: list[str]) -> Result:
    where = f"results {path}, line {line}"
    if len(row) != len(COLUMNS):
        raise FileError(f"{where}: {len(row)} values; expected {len(COLUMNS)}, as in the header")
    numbers: dict[str, int | float] = {}
    for name, text in zip(COLUMNS[len(_TEXT) :], row[len(_TEXT) :], strict=True):
        try:
            numbers[name] = whole_number(text) if name in _COUNTS else real_number(text)
        except ValueError:
            kind = "a whole number" if name in _COUNTS else "a number"
            raise FileError(f"{where}: {name}: {shown(text)}, expected {kind}") from None
    try:
        values = [numbers[name] for name in _NUMBERS]
        result = Result(Case(*row[: len(_TEXT)]), *values)  # type: ignore[arg-type]
    except DeepringError as error:
        raise FileError(f"{where}: {error}") from None
    _check_intervals(where, result, numbers)
    return result


def _check_intervals(where: str, result: Result, numbers: Mapping[str, float]) -> None:
    """Raise FileError for an interval that does not belong to its recall."""
    for recall, columns in _INTERVALS.items():
        for column, bound in zip(columns, result.interval(recall), strict=True):
            if not math.isclose(numbers[column], bound, abs_tol=1e-6):
                raise FileError(
                    f"{where}: {column}: {numbers[column]}, expected a bound of {bound:.6f}, for "
                    f"a {recall} of {getattr(result, recall)} among {result.answerable} queries; "
                    "run the evaluation again"
                )


def _row(result: Result) -> list[str | float]:
    row: list[str | float] = [*result.case.columns.values()]
    for name in _NUMBERS:
        row.append(getattr(result, name))
        if name in _INTERVALS:
            row += result.interval(name)
    return row
