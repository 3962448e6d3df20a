"""Results of evaluations, one per line of a CSV file."""

import csv
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from deepring import checks
from deepring.errors import DataError, DeepringError, FileError
from deepring.evaluation.case import Case
from deepring.evaluation.csv_errors import CSV_ERRORS, csv_reason
from deepring.io.files import replacing
from deepring.io.numbers_as_text import real_number, whole_number
from deepring.text import shown


@dataclass(frozen=True)
class Result:
    """Rates and times of one case at one revisit radius: one row of the CSV file.

    Rates lie in [0, 1]; ``recall_1`` and ``recall_5`` are shares of the answerable queries.
    Raises ConfigError for a value of another type or out of its range, and DataError for more
    answerable queries than queries.
    """

    case: Case
    radius_m: float
    database: int  # places
    queries: int
    answerable: int  # queries with a database place within the radius
    recall_1: float
    recall_5: float
    f1_max: float
    auc: float
    seconds_per_scan: float  # from points to descriptor
    seconds_per_query: float  # search of the whole database

    def __post_init__(self) -> None:
        checks.positive("radius_m", self.radius_m, "metres")
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


_TEXT = tuple(field.name for field in fields(Case))
_NUMBERS = tuple(field.name for field in fields(Result) if field.name != "case")
COLUMNS = _TEXT + _NUMBERS
_COUNTS = ("database", "queries", "answerable")
_RATES = ("recall_1", "recall_5", "f1_max", "auc")


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
        writer.writerows([*astuple(result)[0], *astuple(result)[1:]] for result in results)


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
    texts, numbers = row[: len(_TEXT)], row[len(_TEXT) :]
    values: list[int | float] = []
    for name, text in zip(_NUMBERS, numbers, strict=True):
        try:
            values.append(whole_number(text) if name in _COUNTS else real_number(text))
        except ValueError:
            kind = "a whole number" if name in _COUNTS else "a number"
            raise FileError(f"{where}: {name}: {shown(text)}, expected {kind}") from None
    try:
        return Result(Case(*texts), *values)  # type: ignore[arg-type]
    except DeepringError as error:
        raise FileError(f"{where}: {error}") from None
