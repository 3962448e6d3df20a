"""Recall@N of a case over N, as the field draws it: in memory, and as a CSV file of a run."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path

import torch

from deepring import checks
from deepring.errors import DataError, DeepringError, FileError
from deepring.evaluation.case import Case
from deepring.evaluation.csv_errors import CSV_ERRORS, csv_reason
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import first_right_among, recall_of_ranks
from deepring.io.files import replacing
from deepring.io.numbers_as_text import real_number
from deepring.text import shown

#: The largest N.
MOST = 25

#: The file of these in a run's folder.
FILE = "recalls.csv"

_TEXT = tuple(field.name for field in fields(Case))
COLUMNS = (*_TEXT, "radius_m", *(f"recall_{n}" for n in range(1, MOST + 1)))


@dataclass(frozen=True)
class RecallCurve:
    """Recall@1 to Recall@25 of one case at one revisit radius, over the answerable queries.

    Raises ConfigError for a radius or a recall out of range, and DataError for none, more than
    `MOST`, or recalls that fall.
    """

    case: Case
    radius_m: float
    recalls: tuple[float, ...]
    """Of N = 1, 2 and so on; fewer than `MOST` where a query has no more places to look at."""

    def __post_init__(self) -> None:
        checks.positive("radius_m", self.radius_m, "metres")
        for number, recall in enumerate(self.recalls, 1):
            checks.share(f"recall_{number}", recall)
        falls = any(later < earlier for earlier, later in pairwise(self.recalls))
        if falls or not 1 <= len(self.recalls) <= MOST:
            raise DataError(
                f"recalls of {self.case}: {shown(self.recalls)}, expected 1 to {MOST} numbers that "
                "do not fall"
            )


def recall_curves(matches: TopMatches, radii: Sequence[float]) -> list[RecallCurve]:
    """The curve at each radius (metres) within which a query has an answer.

    It ends at the number of places in ``matches``, which holds the best `MOST` of each query, or
    all that the method compares where these are fewer.
    """
    distance, nearest = torch.from_numpy(matches.distance), torch.from_numpy(matches.nearest)
    numbers = range(1, min(MOST, distance.shape[1]) + 1)
    return [
        RecallCurve(
            matches.case,
            float(radius),
            tuple(float(recall_of_ranks(ranks, n, radius)) for n in numbers),
        )
        for radius, ranks in zip(radii, first_right_among(distance, nearest, radii), strict=True)
        if bool((ranks > 0).any())
    ]


def write_recall_curves(folder: str | Path, curves: Iterable[RecallCurve]) -> None:
    """Write the curves of a run, one a row; what a curve lacks is empty.

    Raises FileError if the file cannot be written.
    """
    with (
        replacing(Path(folder) / FILE) as temporary,
        temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for curve in curves:
            lacking = [""] * (MOST - len(curve.recalls))
            row = [*curve.case.columns.values(), curve.radius_m, *curve.recalls, *lacking]
            writer.writerow(row)


def read_recall_curves(folder: str | Path) -> list[RecallCurve]:
    """Read what `write_recall_curves` wrote; none of a run that has no such file.

    Raises FileError for a file that holds something else, naming the line.
    """
    path = Path(folder) / FILE
    if not path.exists():
        return []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            if tuple(next(reader, [])) != COLUMNS:
                raise FileError(f"{path}, line 1: expected {','.join(COLUMNS)!r}; {_AGAIN}")
            return [_parse(path, reader.line_num, row) for row in reader if row]
    except CSV_ERRORS as error:
        raise FileError(f"{path}: {csv_reason(error)}; {_AGAIN}") from error


def _parse(path: Path, line: int, row: list[str]) -> RecallCurve:
    texts, numbers = row[: len(_TEXT)], row[len(_TEXT) :]
    while numbers and not numbers[-1]:
        numbers.pop()
    try:
        if len(row) != len(COLUMNS):
            raise DataError(f"{len(row)} values, expected {len(COLUMNS)}, as in the header")
        radius, *recalls = map(real_number, numbers)
        return RecallCurve(Case(*texts), radius, tuple(recalls))
    except (ValueError, DeepringError) as error:
        reason = error if isinstance(error, DeepringError) else f"{shown(','.join(numbers))}"
        raise FileError(f"{path}, line {line}: {reason}; {_AGAIN}") from None


_AGAIN = "delete the file, or run the evaluation again"
