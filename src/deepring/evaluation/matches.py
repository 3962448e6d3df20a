"""Matches: the places that a method retrieved for each query, in memory and as a CSV file."""

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError, DeepringError, FileError
from deepring.evaluation.case import Case
from deepring.evaluation.csv_errors import CSV_ERRORS, csv_reason
from deepring.evaluation.distances import HasPositions, distances_to
from deepring.io.files import replacing
from deepring.io.numbers_as_text import real_number, whole_number
from deepring.io.strict_json import read_json
from deepring.search.hits import Hits
from deepring.text import shown

#: The folder of these files in a run's folder.
FOLDER = "retrievals"

COLUMNS = ("query", "place", "score", "turn", "distance", "nearest")


@dataclass(frozen=True, eq=False)
class TopMatches:
    """The k best places of each of q queries, best first.

    Raises DataError for arrays whose shapes disagree.
    """

    case: Case
    query: NDArray[np.int64]
    """(q,) numbers of the queries' scans in their session."""
    place: NDArray[np.int64]
    """(q, k) numbers of the places' scans in the database's session."""
    score: NDArray[np.float32]
    """(q, k) higher is more alike; thresholds are compared with the first."""
    turn: NDArray[np.float32] | None
    """(q, k) the turn of the points from place to query, radians; None if it is unknown."""
    distance: NDArray[np.float32]
    """(q, k) metres from the query to the place."""
    nearest: NDArray[np.float32]
    """(q,) metres from the query to the nearest place of the database."""

    def __post_init__(self) -> None:
        best: dict[str, NDArray[Any]] = {"place": self.place, "score": self.score}
        best["distance"] = self.distance
        if self.turn is not None:
            best["turn"] = self.turn
        whole: dict[str, NDArray[Any]] = {"query": self.query, "nearest": self.nearest}
        shapes = {name: array.shape for name, array in (whole | best).items()}
        rows = len(self.query)
        if {shapes[name] for name in whole} != {(rows,)} or (
            {shapes[name] for name in best} != {(rows, max(1, self.place.shape[-1]))}
        ):
            raise DataError(
                f"matches of {self.case}: shapes {shapes}; expected (q,) for query and nearest, "
                "(q, k) with k of at least 1 for the others"
            )

    @classmethod
    def of_hits(
        cls,
        case: Case,
        query: HasPositions,
        database: HasPositions,
        hits: Hits,
        nearest: NDArray[np.float32],
    ) -> "TopMatches":
        """The matches of a search of the database with the result ``hits`` (q, k), on the CPU.

        ``nearest`` (q,) are the distances that `nearest_distances` gives.
        """
        rows = hits.place.numpy()
        return cls(
            case=case,
            query=query.indices,
            place=database.indices[rows],
            score=hits.score.float().numpy(),
            turn=None if hits.turn is None else hits.turn.float().numpy(),
            distance=distances_to(query, database, rows),
            nearest=nearest,
        )


def write_matches(folder: str | Path, matches: TopMatches) -> Path:
    """Write the best place of each query below ``retrievals/`` in a run's folder.

    Returns the file's path. Folders are created as needed. Raises FileError if the file exists and
    holds another case, or cannot be written.
    """
    path = Path(folder) / FOLDER / matches.case.file_name(".csv")
    if path.exists() and (present := _case_at(path)) != matches.case:
        raise FileError(
            f"{path}: holds the retrievals of {present}, expected those of {matches.case}; give "
            "the methods labels that differ in letters or digits, or delete the file"
        )
    m = matches
    turns = repeat("") if m.turn is None else m.turn[:, 0].tolist()
    place, score, distance = (table[:, 0].tolist() for table in (m.place, m.score, m.distance))
    rows = zip(m.query.tolist(), place, score, turns, distance, m.nearest.tolist(), strict=False)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {json.dumps(matches.case.columns)}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    return path


def read_matches(path: str | Path) -> TopMatches:
    """Read what `write_matches` wrote: one place per query, with exactly the same numbers.

    Raises FileError for a file that is missing or holds something else, naming the line.
    """
    path = Path(path)
    case = _case_at(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            file.readline()
            reader = csv.reader(file, strict=True)
            if tuple(next(reader, [])) != COLUMNS:
                raise FileError(f"{path}, line 2: expected {','.join(COLUMNS)!r}; {_AGAIN}")
            rows = [_parse(path, reader.line_num + 1, row) for row in reader if row]
    except CSV_ERRORS as error:
        raise FileError(f"{path}: {csv_reason(error)}; {_EXPECTED}") from error
    query, place, score, turn, distance, nearest = zip(*rows, strict=True) if rows else [()] * 6
    if None in turn and set(turn) != {None}:
        raise FileError(
            f"{path}: turns in {len(turn) - turn.count(None)} of {len(turn)} rows; expected one in "
            f"each or in none; {_AGAIN}"
        )
    return TopMatches(
        case=case,
        query=np.array(query, dtype=np.int64),
        place=np.array(place, dtype=np.int64)[:, None],
        score=np.array(score, dtype=np.float32)[:, None],
        turn=None if None in turn else np.array(turn, dtype=np.float32)[:, None],
        distance=np.array(distance, dtype=np.float32)[:, None],
        nearest=np.array(nearest, dtype=np.float32),
    )


def matches_in(folder: str | Path) -> Iterator[TopMatches]:
    """All matches in a run's folder, sorted by file name."""
    return map(read_matches, sorted((Path(folder) / FOLDER).glob("*.csv")))


def _case_at(path: Path) -> Case:
    """The case in the first line of a file."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            line = file.readline()
    except CSV_ERRORS as error:
        raise FileError(f"{path}: {csv_reason(error)}; {_EXPECTED}") from error
    try:
        return Case(**read_json(line.removeprefix("# ")))
    except (DeepringError, TypeError):
        columns = json.dumps(dict.fromkeys(Case.__dataclass_fields__, "..."))
        raise FileError(
            f"{path}, line 1: {shown(line.strip(), 80)}; expected '# ' and {columns}; {_AGAIN}"
        ) from None


def _parse(
    path: Path, line: int, row: list[str]
) -> tuple[int, int, float, float | None, float, float]:
    try:
        query, place, score, turn, distance, nearest = row
        angle = _float32(turn) if turn else None
        scans = _scan(query), _scan(place)
        return *scans, _float32(score), angle, _metres(distance), _metres(nearest)
    except ValueError:
        raise FileError(
            f"{path}, line {line}: {shown(','.join(row))}; expected two whole numbers and four "
            f"floats ({', '.join(COLUMNS)}), the turn empty if it is unknown; {_AGAIN}"
        ) from None


def _scan(text: str) -> int:
    """The number of a scan."""
    if not 0 <= whole_number(text) < 2**63:
        raise ValueError("no number of a scan")
    return int(text)


_LARGEST = float(np.finfo(np.float32).max)


def _float32(text: str) -> float:
    """The number, if it is one of float32 or infinite."""
    value = real_number(text)
    if math.isfinite(value) and abs(value) > _LARGEST:
        raise ValueError("beyond float32")
    return value


def _metres(text: str) -> float:
    """A distance, which is finite."""
    value = _float32(text)
    if not 0 <= value < math.inf:
        raise ValueError("no distance")
    return value


_AGAIN = "delete the file and run the evaluation again"
_EXPECTED = f"expected the retrievals of an evaluation; {_AGAIN}"
