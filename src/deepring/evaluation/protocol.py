"""The evaluation protocol: one method on one retrieval set, to rows of results."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchmetrics import Metric

from deepring.data.packed_rasters import Rasters
from deepring.data.scan_set import ScanSet
from deepring.errors import DeepringError
from deepring.evaluation.described import (
    AsAsked,
    Described,
    Placed,
    distances_to,
    shortest_distance,
)
from deepring.evaluation.descriptors import Labels
from deepring.evaluation.export import Export
from deepring.evaluation.metrics import MaxF1, PlaceAUC, PlacePrecisionRecall, RecallAtK
from deepring.evaluation.results import Result
from deepring.methods.base import Method
from deepring.methods.describe import describe_all
from deepring.progress import Progress

log = logging.getLogger(__name__)

#: An evaluation sees all queries in one process, also after a distributed training.
ALONE: dict[str, Any] = {"sync_on_compute": False}

#: Scans described and queries compared at a time.
BATCH = 64

#: Revisit radii in metres; the first is the headline.
RADII = (10.0, 5.0, 15.0, 20.0, 25.0)


@dataclass(frozen=True, eq=False)
class Side:
    """The queries or the database: which scans, and their images."""

    scans: ScanSet
    rasters: Rasters

    def __len__(self) -> int:
        return len(self.scans)


@dataclass(frozen=True, eq=False)
class Task:
    """What is looked up where, under which name."""

    test: str
    region: str
    database: Side
    query: Side


@dataclass(frozen=True, eq=False)
class Retrieved:
    """The best place for each of q queries."""

    place: NDArray[np.int64]
    """(q,) its number in the database."""
    score: NDArray[np.float32]
    """(q,) its score; higher is more alike."""
    turn: NDArray[np.float32] | None
    """(q,) the turn of the points from it to the query, radians; None where not known."""
    distance: NDArray[np.float32]
    """(q,) metres from the query to it."""
    nearest: NDArray[np.float32]
    """(q,) metres from the query to the nearest place of the database."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a method made of a task."""

    method: str
    results: list[Result]
    """One row a radius, in the order given."""
    curve: tuple[Tensor, Tensor, Tensor]
    """Precision, recall and thresholds at the first radius."""
    retrieved: Retrieved


def evaluate_method(
    name: str,
    method: Method,
    task: Task,
    radii: Sequence[float] = RADII,
    train: str = "",
    device: torch.device | None = None,
    progress: Progress | None = None,
    export: Path | None = None,
) -> Outcome:
    """Describe both sides, look every query up, and count at each revisit radius (metres).

    ``train`` names what a learned method was trained on. The work is done on ``device``, where
    the method must be; ``progress`` is called with scans done and their total. A radius at which
    no query has an answer is left out with a warning; the first, the headline, raises
    DeepringError then, before anything is described.

    Descriptors of the whole database are held in memory, those of one batch of queries. With
    ``export`` those of all queries are, and both sides are written into that folder, each as one
    file that `deepring.evaluation.scoring` counts again.
    """
    for what, side in (("database", task.database), ("query", task.query)):
        if not len(side):
            raise DeepringError(
                f"{task.test}, region {task.region}: the {what} holds 0 scans; expected at least "
                f"one; mend data.regions.{task.region} or data.{what}"
            )
    labels = Labels(name, train, task.test, task.region)
    check_answerable(labels, task.query.scans, task.database.scans, radii)
    exported = None if export is None else Export(export, labels, method)
    database = describe_side(method, task.database, device, progress)
    per_scan = seconds_per_scan(method, task.query.scans, device)
    if exported is not None:
        exported.add("database", task.database.scans, database, per_scan)
    query = describe_side(method, task.query, device, progress, hold=exported is not None)
    if exported is not None:
        exported.add("query", task.query.scans, query, per_scan)
        exported.write()
    return score_sides(labels, method, query, database, radii, per_scan, device, progress)


def check_answerable(
    labels: Labels, query: Placed, database: Placed, radii: Sequence[float]
) -> None:
    """Raise DeepringError unless all radii are lengths and some query has a place within the first.

    There must be a first.
    """
    if not radii:
        raise DeepringError("evaluation.radii: empty, expected at least one radius in metres")
    for radius in radii:
        RecallAtK(1, radius)  # refuses what is no length
    nearest = shortest_distance(query, database, radii[0], BATCH)
    if not torch.tensor(nearest) <= radii[0]:  # in float32, as the metrics compare
        raise DeepringError(
            f"{labels.test}, region {labels.region}: radius {radii[0]:g} m: 0 of "
            f"{len(query.positions)} queries have a database place within it, the nearest lies at "
            f"{nearest:.4g} m; expected at least one; take a wider radius first, or check that "
            "both sides cover the same ground"
        )


def describe_side(
    method: Method,
    side: Side,
    device: torch.device | None = None,
    progress: Progress | None = None,
    *,
    hold: bool = True,
) -> Described:
    """Describe a side on ``device``, in batches; ``progress`` as in `evaluate_method`.

    Without ``hold`` nothing is described yet: each batch is when it is looked up.
    """
    if not hold:
        return Described(AsAsked(method, side.rasters, device), side.scans.positions)
    descriptors = describe_all(method, side.rasters, BATCH, device, progress)
    return Described(descriptors, side.scans.positions)


def score_sides(
    labels: Labels,
    method: Method,
    query: Described,
    database: Described,
    radii: Sequence[float],
    per_scan: float,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Look every query up, and count at each radius: `evaluate_method` after describing.

    ``per_scan`` is the seconds from points to descriptor, which the rows repeat. Raises
    DeepringError where no query has an answer within the first radius.
    """
    counts = {radius: _metrics(radius) for radius in radii}
    curve = PlacePrecisionRecall(radii[0], **ALONE)
    everything = [curve, *(metric for group in counts.values() for metric in group.values())]
    retrieved, per_query = _look_up(method, query, database, everything, device, progress)

    rows = []
    for radius, group in counts.items():
        answerable = int((retrieved.nearest <= radius).sum())
        if not answerable and radius != radii[0]:
            log.warning("%s: no query has a place within %g m; left out", labels.test, radius)
            continue
        row = Result(
            method=labels.method,
            train=labels.train,
            test=labels.test,
            region=labels.region,
            radius_m=float(radius),
            database=len(database),
            queries=len(query),
            answerable=answerable,
            seconds_per_scan=per_scan,
            seconds_per_query=per_query,
            **{label: float(metric.compute()) for label, metric in group.items()},
        )
        rows.append(row)
    return Outcome(labels.method, rows, curve.compute(), retrieved)


def _metrics(radius: float) -> dict[str, Metric]:
    return {
        "recall_1": RecallAtK(1, radius, **ALONE),
        "recall_5": RecallAtK(5, radius, **ALONE),
        "f1_max": MaxF1(radius, **ALONE),
        "auc": PlaceAUC(radius, **ALONE),
    }


def _look_up(
    method: Method,
    query: Described,
    database: Described,
    metrics: Sequence[Metric],
    device: torch.device | None,
    progress: Progress | None,
) -> tuple[Retrieved, float]:
    """The best place a query, and seconds to look one up; metrics see each batch of scores."""
    entries = database.descriptors[:].to(device)
    columns: list[tuple[Tensor, ...]] = []
    best_turns: list[Tensor] = []
    seconds = 0.0
    for start in range(0, len(query), BATCH):
        rows = slice(start, start + BATCH)
        described = query.descriptors[rows].to(device)
        if described.is_cuda:  # else the clock would count what is still being described
            torch.cuda.synchronize(described.device)
        started = time.perf_counter()
        score, turn = method.compare(described, entries)
        score = score.cpu()  # waits for the device
        best = score.argmax(dim=1, keepdim=True)
        seconds += time.perf_counter() - started
        distances = distances_to(database, query.positions[rows])
        for metric in metrics:
            metric.update(score, distances)
        columns.append(
            (best, score.gather(1, best), distances.gather(1, best), distances.amin(1, True))
        )
        if progress is not None:
            progress(min(rows.stop, len(query)), len(query))
        if turn is not None:
            best_turns.append(turn.cpu().gather(1, best))
    place, top, distance, nearest = (
        torch.cat(column).squeeze(1).numpy() for column in zip(*columns, strict=True)
    )
    turns = torch.cat(best_turns).squeeze(1).numpy() if best_turns else None
    return Retrieved(place, top, turns, distance, nearest), seconds / len(query)


def seconds_per_scan(
    method: Method, scans: ScanSet, device: torch.device | None = None, count: int = 32
) -> float:
    """Median seconds from the points of a scan to its descriptor, one scan at a time.

    Reading the file is left out; up to ``count`` scans, spread over the set.
    """
    session = scans.session
    times = []
    for k in np.linspace(0, len(scans) - 1, min(count, len(scans))).astype(int):
        points = session.points(int(scans.indices[k]))
        started = time.perf_counter()
        raster = method.raster(points, scans.ground_z)
        method.describe(torch.from_numpy(raster)[None].to(device)).cpu()
        times.append(time.perf_counter() - started)
    return float(np.median(times))
