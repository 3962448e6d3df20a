"""The evaluation protocol: matches and results of one method on one retrieval task."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.data.scan_set import ScanSet
from deepring.errors import ConfigError, DataError
from deepring.evaluation.case import Case
from deepring.evaluation.counting import check_grey_zone, count
from deepring.evaluation.distances import nearest_distances
from deepring.evaluation.export import Export
from deepring.evaluation.look_up import BEST, best_of
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.online import look_up_among
from deepring.evaluation.pose_errors import PoseErrors
from deepring.evaluation.results import Result
from deepring.evaluation.task import RetrievalTask
from deepring.methods.method import Method, describe_batches
from deepring.progress import Progress

#: Scans described and queries looked up at a time.
BATCH = 64

#: Revisit radii in metres; the first is the headline.
RADII = (10.0, 5.0, 15.0, 20.0, 25.0)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Matches and results of a method."""

    matches: TopMatches
    results: list[Result]
    """One per radius, in the order of the radii."""
    poses: PoseErrors | None = None
    """Errors of the relative poses of the best places, where the method tells these."""

    @property
    def case(self) -> Case:
        """The method, and where it was tested."""
        return self.matches.case


def evaluate_method(
    case: Case,
    method: Method,
    task: RetrievalTask,
    radii: Sequence[float] = RADII,
    *,
    best: int = BEST,
    device: torch.device | None = None,
    progress: Progress | None = None,
    export: Path | None = None,
    wrong_beyond: float | None = None,
) -> Outcome:
    """Describe both sides, look every query up, and count at each revisit radius (metres).

    A radius within which no query has an answer is left out with a warning. The index holds the
    whole database, or where queries are online what is old enough; of the queries one batch is in
    memory at a time, but with ``export`` all are.

    Args:
        case: as `RetrievalTask.case` gives it.
        method: on ``device``.
        task: in the method's raster.
        radii: the headline first.
        best: least number of matches per query; 5 and 1 % of the places are kept anyway.
        device: where the method describes scans; None is the CPU.
        progress: called with scans done and their total.
        export: folder for the descriptors, one file per side, which
            `deepring.evaluation.scoring` evaluates again.
        wrong_beyond: metres, see `deepring.evaluation.counting`.

    Raises:
        ConfigError: no radius, one that is not above 0, or a ``wrong_beyond`` below one.
        DataError: an empty side, or no query with an answer within the first radius, before
            anything is described.
    """
    query, database = task.scans.query, task.scans.database
    for what, side in (("database", database), ("query", query)):
        if not len(side):
            raise DataError(
                f"{case.test}, region {case.region}: the {what} holds 0 scans; expected at least "
                "one; take a wider region or another session"
            )
    searched = task.scans.searched
    nearest = nearest_distances(query, database, searched)
    check_answerable(case, nearest, radii)
    check_grey_zone(radii, wrong_beyond)
    writer = None if export is None else Export(export, case, method)

    places: Iterable[Tensor] = describe_batches(method, task.database, BATCH, device, progress)
    queries: Iterable[Tensor] = describe_batches(method, task.query, BATCH, device, progress)
    if writer is not None:
        places = list(places)
        per_scan = seconds_per_scan(method, query, device)
        writer.add("database", database, torch.cat(places), per_scan)
        queries = list(queries)
        writer.add("query", query, torch.cat(queries), per_scan, task.scans.before)
        writer.write()
    k = best_of(len(database), best)
    hits, per_query = look_up_among(method, places, queries, k, searched)
    if writer is None:
        per_scan = seconds_per_scan(method, query, device)
    matches = TopMatches.of_hits(case, query, database, hits, nearest)
    results = count(matches, radii, len(database), per_scan, per_query, wrong_beyond, searched)
    return Outcome(matches, results)


def check_answerable(case: Case, nearest: NDArray[np.float32], radii: Sequence[float]) -> None:
    """Raise ConfigError unless all radii are above 0, and DataError if no query has an answer.

    A query has an answer if ``nearest`` (q,), its distance from the nearest place in metres, is at
    most the first radius.
    """
    if not radii:
        raise ConfigError("radii: empty, expected at least one radius in metres")
    for radius in radii:
        checks.positive("radius", radius, "metres")
    if not (nearest <= np.float32(radii[0])).any():
        raise DataError(
            f"{case.test}, region {case.region}: radius {radii[0]:g} m: 0 of {len(nearest)} "
            f"queries have a database place within it, the nearest lies at {nearest.min():.4g} m; "
            "expected at least one; begin with a wider radius, or check that both sides cover "
            "the same ground"
        )


def seconds_per_scan(
    method: Method, scans: ScanSet, device: torch.device | None = None, count: int = 32
) -> float:
    """Median seconds from the points of a scan to its descriptor, one scan at a time.

    Reading the files is not timed. Up to ``count`` scans are taken, spread over the set.
    """
    session = scans.session
    times = []
    for k in np.linspace(0, len(scans) - 1, min(count, len(scans))).astype(int):
        points = session.points(int(scans.indices[k]), method.raster.columns)
        started = time.perf_counter()
        raster = method.raster(points, scans.ground_z)
        method.describe(torch.from_numpy(raster)[None].to(device)).cpu()
        times.append(time.perf_counter() - started)
    return float(np.median(times))
