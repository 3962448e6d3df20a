"""What a method retrieved for each query, as a CSV file, and the curve that comes of it."""

import csv
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from deepring.errors import DeepringError
from deepring.evaluation.metrics import place_precision_recall
from deepring.evaluation.protocol import Retrieved
from deepring.io.files import replacing

#: The folder of these files in a run's folder.
FOLDER = "retrievals"

COLUMNS = ("query", "place", "score", "turn", "distance", "nearest")
_LABELS = ("method", "train", "test", "region")


@dataclass(frozen=True, eq=False)
class Retrievals:
    """The top-1 decision of each of q queries in one test of one method."""

    method: str
    train: str
    """Dataset it was trained on; empty for a method without training."""
    test: str
    region: str
    query: NDArray[np.int64]
    """(q,) index of the scan in its session."""
    place: NDArray[np.int64]
    """(q,) index of the retrieved scan in the database's session."""
    score: NDArray[np.float32]
    """(q,) higher is more alike."""
    turn: NDArray[np.float32] | None
    """(q,) the turn of the points from the place to the query, radians; None where not known."""
    distance: NDArray[np.float32]
    """(q,) metres from the query to the place."""
    nearest: NDArray[np.float32]
    """(q,) metres from the query to the nearest place of the database."""

    @property
    def file_name(self) -> str:
        """'Scan_Context_20x60__sim_nclt__test.csv': letters, digits, '-' and '_' alone."""
        return "__".join(map(_safe, (self.method, self.test, self.region))) + ".csv"


def write_retrievals(
    folder: str | Path,
    method: str,
    train: str,
    test: str,
    region: str,
    retrieved: Retrieved,
    query_indices: ArrayLike,
    database_indices: ArrayLike,
) -> Path:
    """Write what was retrieved below ``retrievals/`` in a run's folder; the file's path.

    Args:
        folder: the run's; folders are created as needed.
        method: its label; this and the next three as in `Result`.
        train: what it was trained on, "" for a method without training.
        test: the dataset it was tested on.
        region: where it was tested.
        retrieved: the best place for each of q queries.
        query_indices: (q,) whole numbers, of the queries' scans in their session.
        database_indices: (d,) whole numbers, of the database's scans in theirs.

    Raises:
        DeepringError: indices that do not fit, another test's file under the same name, or a file
            that cannot be written.
    """
    queries = np.asarray(query_indices, dtype=np.int64)
    places = np.asarray(database_indices, dtype=np.int64)
    r = retrieved
    if queries.shape != r.place.shape or places.ndim != 1 or (r.place >= len(places)).any():
        raise DeepringError(
            f"query_indices {queries.shape}, database_indices {places.shape}: expected one a "
            f"query, {r.place.shape}, and one a place of the database, more than "
            f"{max(r.place, default=0)}; give those of the scans that were looked up"
        )
    found = places[r.place]
    kept = Retrievals(
        method, train, test, region, queries, found, r.score, r.turn, r.distance, r.nearest
    )
    path = Path(folder) / FOLDER / kept.file_name
    if path.exists() and _labels(kept) != (other := _labels_at(path)):
        raise DeepringError(
            f"{path}: holds the retrievals of {other}, expected those of {_labels(kept)}; give "
            "the methods labels that differ in letters or digits, or delete the file"
        )
    _write(path, kept)
    return path


def read_retrievals(path: str | Path) -> Retrievals:
    """Read what `write_retrievals` wrote; every number is the same again.

    Raises DeepringError for a file that is missing or holds something else, naming the line.
    """
    path = Path(path)
    labels = _labels_at(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            file.readline()
            reader = csv.reader(file, strict=True)
            if tuple(next(reader, [])) != COLUMNS:
                raise DeepringError(f"{path}, line 2: expected {','.join(COLUMNS)!r}; {_AGAIN}")
            rows = [_parse(path, reader.line_num + 1, row) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DeepringError(f"{path}: {error}; {_WANTED}") from error
    query, place, score, turn, distance, nearest = zip(*rows, strict=True) if rows else [()] * 6
    return Retrievals(
        **labels,
        query=np.array(query, dtype=np.int64),
        place=np.array(place, dtype=np.int64),
        score=np.array(score, dtype=np.float32),
        turn=None if None in turn else np.array(turn, dtype=np.float32),
        distance=np.array(distance, dtype=np.float32),
        nearest=np.array(nearest, dtype=np.float32),
    )


def retrievals_in(folder: str | Path) -> Iterator[Retrievals]:
    """All that lie in a run's folder, sorted by file name; none where there are none."""
    return map(read_retrievals, sorted((Path(folder) / FOLDER).glob("*.csv")))


def precision_recall_of(
    distance: ArrayLike, nearest: ArrayLike, score: ArrayLike, radius: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Precision, recall and thresholds (t,) of top-1 decisions, as `place_precision_recall`.

    Args:
        distance: (q,) metres from the query to the retrieved place.
        nearest: (q,) metres from the query to the nearest place; says which are answerable.
        score: (q,) of the retrieved place.
        radius: revisit radius in metres.

    Raises:
        DeepringError: as `place_precision_recall`.
    """
    found, closest, top = map(torch.as_tensor, (distance, nearest, score))
    if not found.shape == closest.shape == top.shape or top.ndim != 1:
        raise DeepringError(
            f"distance {tuple(found.shape)}, nearest {tuple(closest.shape)}, score "
            f"{tuple(top.shape)}: expected (q,) each; give one of each a query"
        )
    # Two places a query: the retrieved one, and the nearest one ranked behind it. Where only the
    # nearest is right, the rank is 2: answerable, and answered wrongly.
    scores = torch.stack([top, torch.full_like(top, -torch.inf)], dim=1)
    return place_precision_recall(scores, torch.stack([found, closest], dim=1), radius)


def _write(path: Path, kept: Retrievals) -> None:
    turns = repeat("") if kept.turn is None else kept.turn.tolist()
    numbers = (kept.query, kept.place, kept.score, kept.distance, kept.nearest)
    query, place, score, distance, nearest = (column.tolist() for column in numbers)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {json.dumps(_labels(kept))}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(zip(query, place, score, turns, distance, nearest, strict=False))


def _labels(kept: Retrievals) -> dict[str, str]:
    return {name: getattr(kept, name) for name in _LABELS}


def _labels_at(path: Path) -> dict[str, str]:
    """The labels in the first line of a file."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            line = file.readline()
    except (OSError, UnicodeDecodeError) as error:
        raise DeepringError(f"{path}: {error}; {_WANTED}") from error
    try:
        labels = json.loads(line.removeprefix("# "))
    except ValueError:
        labels = None
    if isinstance(labels, dict) and sorted(labels) == sorted(_LABELS):
        return {name: str(labels[name]) for name in _LABELS}
    raise DeepringError(
        f"{path}, line 1: {line.strip()[:80]!r}; expected '# ' and "
        f"{json.dumps(dict.fromkeys(_LABELS, '...'))}; {_AGAIN}"
    )


def _parse(
    path: Path, line: int, row: list[str]
) -> tuple[int, int, float, float | None, float, float]:
    try:
        query, place, score, turn, distance, nearest = row
        angle = float(turn) if turn else None
        return int(query), int(place), float(score), angle, float(distance), float(nearest)
    except ValueError:
        raise DeepringError(
            f"{path}, line {line}: {','.join(row)!r}; expected two whole numbers and four floats "
            f"({', '.join(COLUMNS)}), turn empty where not known; {_AGAIN}"
        ) from None


def _safe(label: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", label)


_AGAIN = "delete the file and run the evaluation again"
_WANTED = f"expected the retrievals of an evaluation; {_AGAIN}"
