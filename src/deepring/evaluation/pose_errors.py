"""How far off the relative poses are that a method tells of its best places."""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import wrap_angle, yaw_of
from deepring.errors import DataError
from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.task import RetrievalTask, rows_of
from deepring.io.files import replacing
from deepring.localization.calibration import Tolerance
from deepring.methods.method import RelativePoses
from deepring.progress import Progress

Floats = NDArray[np.float64]

#: The file of a run.
FILE = "relative_poses.csv"

COLUMNS = (
    *("method", "train", "test", "region", "radius_m", "places"),
    *("right", "median_m", "median_degrees"),
)


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Relative poses of the queries whose best place is within the radius, beside the true ones.

    Errors are planar, as those of a location are: z, roll and pitch do not count. A pose that
    cannot be told is infinitely far off.
    """

    case: Case
    radius_m: float
    metres: Floats
    """(n,) between the positions of the query's sensor in the place's frame, told and true."""
    degrees: Floats
    """(n,) between the turns."""

    @property
    def right(self) -> int:
        """How many are right, within 2 m and 5° (`Tolerance`)."""
        tolerance = Tolerance()
        within = (self.metres < tolerance.metres) & (self.degrees < tolerance.degrees)
        return int(within.sum())

    @property
    def medians(self) -> tuple[float, float]:
        """Median metres and degrees over all of them; infinite without any."""
        if not len(self.metres):
            return np.inf, np.inf
        return float(np.median(self.metres)), float(np.median(self.degrees))


def pose_errors(
    method: RelativePoses,
    task: RetrievalTask,
    matches: TopMatches,
    radius: float,
    progress: Progress | None = None,
) -> PoseErrors:
    """The relative poses of the best places that lie within ``radius`` metres of their query.

    Args:
        method: the one that the matches are of.
        task: in the method's raster.
        matches: of the task.
        radius: metres, within which a place is right.
        progress: called with poses done and their total.

    Raises:
        DataError: poses of another shape than `RelativePoses` says.
    """
    found = np.flatnonzero(matches.distance[:, 0] <= np.float32(radius))
    queries = rows_of(task.scans.query, matches.query[found])
    places = rows_of(task.scans.database, matches.place[found, 0])
    told = np.empty((len(found), 4, 4))
    for k, (query, place) in enumerate(zip(queries, places, strict=True)):
        pose = method.relative_poses(task.query[query : query + 1][0], task.database[[place]])
        if tuple(pose.shape) != (1, 4, 4):
            raise DataError(f"relative_poses: shape {tuple(pose.shape)}, expected (1, 4, 4)")
        told[k] = pose[0].cpu().numpy()
        if progress is not None:
            progress(k + 1, len(found))
    sides = (task.scans.query, queries), (task.scans.database, places)
    of_query, of_place = (scans.frames[rows] for scans, rows in sides)
    metres, degrees = planar_errors(told, np.linalg.inv(of_query) @ of_place)
    return PoseErrors(matches.case, float(radius), metres, degrees)


def planar_errors(told: Floats, true: Floats) -> tuple[Floats, Floats]:
    """Metres and degrees (n,) between relative poses (n, 4, 4); infinite where one is NaN."""
    positions = [
        -(poses[:, :3, :3].swapaxes(1, 2) @ poses[:, :3, 3:])[:, :2, 0] for poses in (told, true)
    ]
    metres = np.linalg.norm(positions[0] - positions[1], axis=1)
    degrees = np.abs(np.degrees(wrap_angle(yaw_of(told) - yaw_of(true))))
    return np.nan_to_num(metres, nan=np.inf), np.nan_to_num(degrees, nan=np.inf)


def write_pose_errors(path: str | Path, errors: Iterable[PoseErrors]) -> None:
    """Write one row for each method and region as CSV; medians of poses that are not told are inf.

    Raises FileError if the file cannot be written.
    """
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for each in errors:
            counts = each.radius_m, len(each.metres), each.right
            writer.writerow([*each.case.columns.values(), *counts, *each.medians])
