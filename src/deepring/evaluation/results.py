"""One line a result: a method, trained on one dataset, tested on a region of another."""

import csv
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from deepring.errors import DeepringError
from deepring.io.files import replacing


@dataclass(frozen=True)
class Result:
    """What one method reaches at one revisit radius (protocol: Metrics). One row of the CSV file.

    Rates lie in [0, 1]; ``recall_1`` and ``recall_5`` are shares of the answerable queries.
    Raises DeepringError for a value out of its range or of another type.
    """

    method: str
    train: str  # dataset it was trained on; empty for a method without training
    test: str
    region: str
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
        for field in fields(self):
            value = getattr(self, field.name)
            if not _fits(field.name, value):
                raise DeepringError(
                    f"{field.name} {value!r} ({type(value).__name__}): expected "
                    f"{_expected(field.name)}"
                )
        if self.answerable > self.queries:
            raise DeepringError(
                f"answerable {self.answerable}: expected at most queries {self.queries}"
            )


COLUMNS = tuple(field.name for field in fields(Result))
_TEXT = ("method", "train", "test", "region")
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
        writer.writerows(astuple(result) for result in results)


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
    values: list[str | int | float] = []
    for name, text in zip(COLUMNS, row, strict=True):
        kind = str if name in _TEXT else int if name in _COUNTS else float
        try:
            values.append(kind(text))
        except ValueError:
            raise DeepringError(f"{where}: {name} {text!r}: expected {_expected(name)}") from None
    try:
        return Result(*values)  # type: ignore[arg-type]  # each has its column's type
    except DeepringError as error:
        raise DeepringError(f"{where}: {error}") from None


def _fits(name: str, value: object) -> bool:
    if name in _TEXT:
        return isinstance(value, str) and value.isprintable()
    if name in _COUNTS:
        return isinstance(value, int) and value >= 0
    if not isinstance(value, (int, float)):
        return False
    if name in _RATES:
        return 0 <= value <= 1
    return 0 < value < math.inf if name == "radius_m" else 0 <= value < math.inf


def _expected(name: str) -> str:
    if name in _TEXT:
        return "a str without control characters"
    if name in _COUNTS:
        return "an int >= 0"
    if name in _RATES:
        return "a float in [0, 1]; convert tensors with float()"
    return f"a finite float {'>' if name == 'radius_m' else '>='} 0; convert tensors with float()"
