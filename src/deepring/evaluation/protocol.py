"""The evaluation protocol: one method on one retrieval set, to rows of results."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchmetrics import Metric

from deepring.data.cache import Progress, Rasters, ScanSet
from deepring.data.dataset import distances_between
from deepring.errors import DeepringError
from deepring.evaluation.metrics import MaxF1, PlaceAUC, PlacePrecisionRecall, RecallAtK
from deepring.evaluation.results import Result
from deepring.evaluation.retrieval import describe_all
from deepring.methods.base import Method

log = logging.getLogger(__name__)

#: An evaluation sees all queries in one process, also after a distributed training.
ALONE: dict[str, Any] = {"sync_on_compute": False}

#: Queries compared at a time.
BATCH = 64


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
    yaw: NDArray[np.float32] | None
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
    radii: Sequence[float] = (10.0, 5.0, 15.0, 20.0, 25.0),
    train: str = "",
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Describe both sides, look every query up, and count at each revisit radius (metres).

    ``train`` names what a learned method was trained on. The work is done on ``device``, where
    the method must be; ``progress`` is called with scans done and their total. A radius at which
    no query has an answer is left out with a warning; the first, the headline, raises
    DeepringError then.
    """
    for what, side in (("database", task.database), ("query", task.query)):
        if not len(side):
            raise DeepringError(
                f"{task.test}, region {task.region}: the {what} holds 0 scans; expected at least "
                f"one; mend data.regions.{task.region} or data.{what}"
            )
    if not radii:
        raise DeepringError("evaluation.radii: empty, expected at least one radius in metres")
    counts = {radius: _metrics(radius) for radius in radii}
    curve = PlacePrecisionRecall(radii[0], **ALONE)
    everything = [curve, *(metric for group in counts.values() for metric in group.values())]
    retrieved, seconds_per_query = _retrieve(method, task, everything, device, progress)

    per_scan = seconds_per_scan(method, task.query.scans, device)
    rows = []
    for radius, group in counts.items():
        answerable = int((retrieved.nearest <= radius).sum())
        if not answerable and radius != radii[0]:
            log.warning("%s: no query has a place within %g m; left out", task.test, radius)
            continue
        row = Result(
            method=name,
            train=train,
            test=task.test,
            region=task.region,
            radius_m=float(radius),
            database=len(task.database),
            queries=len(task.query),
            answerable=answerable,
            seconds_per_scan=per_scan,
            seconds_per_query=seconds_per_query,
            **{label: float(metric.compute()) for label, metric in group.items()},
        )
        rows.append(row)
    return Outcome(name, rows, curve.compute(), retrieved)


def _metrics(radius: float) -> dict[str, Metric]:
    return {
        "recall_1": RecallAtK(1, radius, **ALONE),
        "recall_5": RecallAtK(5, radius, **ALONE),
        "f1_max": MaxF1(radius, **ALONE),
        "auc": PlaceAUC(radius, **ALONE),
    }


def _retrieve(
    method: Method,
    task: Task,
    metrics: Sequence[Metric],
    device: torch.device | None,
    progress: Progress | None,
) -> tuple[Retrieved, float]:
    """The best place a query, and seconds to look one up; metrics see each batch of scores.

    Descriptors of the whole database are held in memory, those of one batch of queries.
    """
    database = describe_all(method, task.database.rasters, BATCH, device, progress)
    columns: list[tuple[Tensor, ...]] = []
    turns: list[Tensor] = []
    seconds = 0.0
    for start in range(0, len(task.query), BATCH):
        rows = slice(start, start + BATCH)
        query = method.describe(task.query.rasters[rows].to(device))
        started = time.perf_counter()
        score, yaw = method.compare(query, database)
        score = score.cpu()  # waits for the device
        best = score.argmax(dim=1, keepdim=True)
        seconds += time.perf_counter() - started
        distances = distances_between(task.query.scans.positions[rows], task.database.scans)
        for metric in metrics:
            metric.update(score, distances)
        columns.append(
            (best, score.gather(1, best), distances.gather(1, best), distances.amin(1, True))
        )
        if progress is not None:
            progress(min(rows.stop, len(task.query)), len(task.query))
        if yaw is not None:
            turns.append(yaw.cpu().gather(1, best))
    place, top, distance, nearest = (
        torch.cat(column).squeeze(1).numpy() for column in zip(*columns, strict=True)
    )
    yaws = torch.cat(turns).squeeze(1).numpy() if turns else None
    return Retrieved(place, top, yaws, distance, nearest), seconds / len(task.query)


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
