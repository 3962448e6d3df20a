"""A trajectory of a drive from above on a page, with the loops among its keyframes."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deepring.localization.drives.drive_result import DriveResult
from deepring.reports.ground_frame import Frame
from deepring.reports.marks import legend, line_legend, mark_legend, marks


def drive_drawing(result: DriveResult, name: str) -> str:
    """The trajectory of this name, and the loops as lines between keyframes, with a legend.

    Where the truth is known it lies below, and the trajectory is aligned with it. No line leads
    across a break of the odometry. All trajectories of a result are drawn over the same ground.
    """
    aligned = {each: poses[:, :2, 3] for each, poses in result.aligned().items()}
    truth = [] if result.truth is None else [result.truth.poses[result.truth.known][:, :2, 3]]
    frame = Frame(np.concatenate([*aligned.values(), *truth]))
    drawn = list(_drawn(frame, result, name, aligned[name], truth))
    entries = [entry for entry, _ in drawn]
    described = ", ".join(words for _, words in entries)
    parts = [part for _, part in drawn]
    return legend(entries) + frame.drawn(parts, ("x", "y"), described, "map")


def _drawn(
    frame: Frame,
    result: DriveResult,
    name: str,
    positions: NDArray[np.float64],
    truth: list[NDArray[np.float64]],
) -> Iterator[tuple[tuple[str, str], str]]:
    """Each thing that is drawn of a trajectory (n, 2): its entry in the legend, and its element."""
    if truth:
        yield line_legend("truth", "true poses"), frame.lines(truth, "truth")
    yield line_legend(name, "trajectory"), frame.lines(result.parts(positions), name)
    keyframes = positions[result.graph.scans]
    for loops, kind, words in (
        (result.kept, "loop", "loops"),
        (result.rejected, "loop rejected", "loops rejected"),
    ):
        strips = [keyframes[[loop.earlier, loop.keyframe]] for loop in loops]
        if strips:
            yield line_legend(kind, f"{words} ({len(strips)})"), frame.lines(strips, kind)
    if result.graph.breaks:
        lost = keyframes[list(result.graph.breaks)]
        yield mark_legend("lost", "odometry lost"), marks(map(frame.at, lost), "lost")
    yield mark_legend("start", "start"), marks([frame.at(positions[0])], "start")
