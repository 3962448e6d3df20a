"""A drive as one HTML page: what was found, its picture, errors and loops."""

from collections.abc import Sequence

import numpy as np

from deepring.data.spacing import path_lengths
from deepring.localization.drives.drive_result import DriveResult, TrajectoryErrors
from deepring.reports.drive_drawing import drive_drawing
from deepring.reports.html import (
    figure,
    heading,
    long_table,
    page,
    paragraph,
    pictures_in_rows,
    table,
)

#: Loops in the table; all are in the JSON file.
_LISTED = 200

_PICTURES = {"odometry": "The drive from above", "optimized": "Optimised"}

_TITLES = {"odometry": "before", "optimized": "optimised"}


def drive_page(result: DriveResult) -> str:
    """The page, which needs no network and no other file."""
    track = result.track
    parts = [
        table(("", ""), summary_rows(result)),
        *(paragraph(f"Mind: {doubt}.") for doubt in track.doubts),
        pictures_in_rows(
            (
                figure(
                    drive_drawing(result, name),
                    f"{_PICTURES[name]}; loops join keyframes",
                    "ground",
                )
                for name in result.trajectories()
            ),
            "wide",
        ),
    ]
    errors = result.errors()
    if errors:
        parts += [heading("Errors beside the true poses"), _errors_table(errors)]
        parts.append(
            paragraph(
                "Absolute: distances after a rigid alignment without scale. Relative: the motion "
                "over stretches of the true path."
            )
        )
    if result.graph.loops:
        parts += [heading("Loops"), _loops_table(result)]
        rest = len(result.graph.loops) - _LISTED
        if rest > 0:
            parts.append(paragraph(f"And {rest} more, in the JSON file."))
    return page(f"The drive {track.name}", parts)


def summary_rows(result: DriveResult) -> list[tuple[str, str]]:
    """What was found, as names and values."""
    track, graph = result.track, result.graph
    rows = [
        ("scans", str(len(track.scans))),
        ("path", f"{path_lengths(track.poses[:, :3, 3])[-1]:.0f} m"),
        ("poses", "odometry by KISS-ICP" if track.by_odometry else "the drive's own"),
        ("ground", f"{result.ground_z:.2f} m in the scans' frame"),
        ("keyframes", str(len(graph.scans))),
        ("loops", str(len(graph.loops))),
    ]
    if track.by_odometry:
        deskewed = f"{track.deskewed} of {len(track.scans)} scans"
        rows.insert(3, ("deskewed", deskewed if track.deskewed else "no, points have no times"))
    if any(loop.inliers is not None for loop in graph.loops):
        rows.append(("refined", str(sum(loop.refined for loop in graph.loops))))
    if result.optimized is not None:
        rows.append(("rejected", str(len(result.rejected))))
    return rows


def error_rows(errors: dict[str, TrajectoryErrors]) -> list[tuple[str, ...]]:
    """Rows of a table: a trajectory, its absolute and its relative errors."""
    rows = []
    for name, found in errors.items():
        row = [_TITLES[name], f"{found.absolute.rmse:.2f} m", f"{found.absolute.largest:.2f} m"]
        row += [f"{one.shift:.2f} m, {one.turn:.2f}°" for one in found.relative]
        rows.append(tuple(row))
    return rows


def error_head(errors: dict[str, TrajectoryErrors]) -> Sequence[str]:
    """The names of the columns of `error_rows`."""
    lengths = next(iter(errors.values())).relative
    return ("", "ATE", "largest", *(f"RPE over {one.metres:g} m" for one in lengths))


def _errors_table(errors: dict[str, TrajectoryErrors]) -> str:
    return table(error_head(errors), error_rows(errors))


def _loops_table(result: DriveResult) -> str:
    rejected = {id(loop) for loop in result.rejected}
    names, rows = result.track.names, result.graph.scans
    head = ("scan", "sees", "x m", "y m", "yaw °", "fit", "inliers", "accepted")
    return long_table(
        head,
        (
            (
                names[rows[loop.keyframe]],
                names[rows[loop.earlier]],
                f"{loop.x:.2f}",
                f"{loop.y:.2f}",
                f"{np.degrees(loop.yaw):.1f}",
                f"{loop.fit:.2f}",
                "" if loop.inliers is None else f"{loop.inliers:.0%}",
                "" if result.optimized is None else "no" if id(loop) in rejected else "yes",
            )
            for loop in result.graph.loops[:_LISTED]
        ),
        ("sees", "accepted"),
    )
