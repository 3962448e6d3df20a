"""Results of evaluations, one per line of a CSV file: a case, a radius, and what was reached."""

import csv
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.io.files import replacing


@dataclass(frozen=True)
class Result:
    """What one case reaches at one revisit radius (protocol: Metrics). One row of the CSV file.

    Rates lie in [0, 1]; ``recall_1`` and ``recall_5`` are shares of the answerable queries.
    Raises DeepringError for a value out of its range or of another type.
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
        for name in _NUMBERS:
            value = getattr(self, name)
            if not _fits(name, value):
                raise DeepringError(
                    f"{name} {value!r} ({type(value).__name__}): expected {_expected(name)}"
                )
        if self.answerable > self.queries:
            raise DeepringError(
                f"answerable {self.answerable}: expected at most queries {self.queries}"
            )


_TEXT = tuple(field.name for field in fields(Case))
_NUMBERS = tuple(field.name for field in fields(Result) if field.name != "case")
COLUMNS = _TEXT + _NUMBERS
_COUNTS = ("database", "queries", "answerable")
_RATES = ("recall_1", "recall_5", "f1_max", "auc")


def write_results(path: str | Path, results: Iterable[Result]) -> None:
    """Write results as CSV (UTF-8, one header line), creating folders as needed.

    The file is replaced in one step, so that a reader never sees half of it. Floats are written
    so that they read back exactly. Raises DeepringError where the file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([*astuple(result)[0], *astuple(result)[1:]] for result in results)


def read_results(path: str | Path) -> list[Result]:
    """Read what ``write_results`` wrote; a byte order mark and blank lines are let pass.

    Raises DeepringError for a file that is missing or no UTF-8 CSV, for another header, and for a
    value of the wrong type or range, naming the line.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            _check_header(path, next(reader, []))
            return [_parse(path, reader.line_num, row) for row in reader if row]
    except OSError as error:
        raise DeepringError(f"results {path}: {error.strerror}; expected a CSV file") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise DeepringError(f"results {path}: {error}; expected CSV in UTF-8") from error


def _check_header(path: Path, header: list[str]) -> None:
    if tuple(header) == COLUMNS:
        return
    missing = [name for name in COLUMNS if name not in header]
    unknown = [name for name in header if name not in COLUMNS]
    raise DeepringError(
        f"results {path}: header {','.join(header)!r} (missing {missing}, unknown {unknown}); "
        f"expected {','.join(COLUMNS)!r}; run the evaluation again, or mend the first line"
    )


def _parse(path: Path, line: int, row: list[str]) -> Result:
    where = f"results {path}, line {line}"
    if len(row) != len(COLUMNS):
        raise DeepringError(f"{where}: {len(row)} values; expected {len(COLUMNS)}, as the header")
    texts, numbers = row[: len(_TEXT)], row[len(_TEXT) :]
    values: list[int | float] = []
    for name, text in zip(_NUMBERS, numbers, strict=True):
        try:
            values.append(int(text) if name in _COUNTS else float(text))
        except ValueError:
            raise DeepringError(f"{where}: {name} {text!r}: expected {_expected(name)}") from None
    try:
        return Result(Case(*texts), *values)  # type: ignore[arg-type]  # each of its column's type
    except DeepringError as error:
        raise DeepringError(f"{where}: {error}") from None


def _fits(name: str, value: object) -> bool:
    if name in _COUNTS:
        return isinstance(value, int) and value >= 0
    if not isinstance(value, (int, float)):
        return False
    if name in _RATES:
        return 0 <= value <= 1
    return 0 < value < math.inf if name == "radius_m" else 0 <= value < math.inf


def _expected(name: str) -> str:
    if name in _COUNTS:
        return "an int >= 0"
    if name in _RATES:
        return "a float in [0, 1]; convert tensors with float()"
    return f"a finite float {'>' if name == 'radius_m' else '>='} 0; convert tensors with float()"
