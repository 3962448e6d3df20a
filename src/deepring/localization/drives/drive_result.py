"""What is known of a drive in the end: poses before and after, loops, errors beside the truth."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.poses.trajectory import Trajectory
from deepring.errors import DataError
from deepring.io.stated_json import json_text
from deepring.localization.drives.loop_graph import Loop, LoopGraph, Track
from deepring.localization.drives.pose_graph import Optimized, corrected
from deepring.localization.drives.trajectory_error import (
    LENGTHS,
    AbsoluteError,
    RelativeError,
    absolute_error,
    aligning,
    relative_error,
)

Poses = NDArray[np.float64]


class Truth(NamedTuple):
    """True poses of the scans of a track."""

    poses: Poses
    """(n, 4, 4) world <- scan, in any world."""
    known: NDArray[np.bool_]
    """(n,) which of them are known."""

    @classmethod
    def whole(cls, poses: Poses) -> "Truth":
        """The truth of every scan."""
        return cls(poses, np.ones(len(poses), dtype=np.bool_))


class TrajectoryErrors(NamedTuple):
    """How far a trajectory is off."""

    absolute: AbsoluteError
    relative: list[RelativeError]
    """Over 10 and 100 m, where the path is that long."""


@dataclass(frozen=True, eq=False)
class DriveResult:
    """A drive with its loops, and what an optimisation made of it."""

    track: Track
    graph: LoopGraph
    ground_z: float
    """z of the ground under the sensor in the scans' frame, metres."""
    optimized: Optimized | None = None
    truth: Truth | None = None

    @property
    def kept(self) -> list[Loop]:
        """The loops that an optimisation accepted, or all."""
        return self._loops(accepted=True)

    @property
    def rejected(self) -> list[Loop]:
        """The loops that an optimisation rejected."""
        return self._loops(accepted=False)

    def _loops(self, *, accepted: bool) -> list[Loop]:
        if self.optimized is None:
            return self.graph.loops if accepted else []
        pairs = zip(self.graph.loops, self.optimized.accepted, strict=True)
        return [loop for loop, one in pairs if bool(one) is accepted]

    def parts(self, positions: Poses) -> list[Poses]:
        """Positions (n, d) of all scans, cut where the odometry was lost."""
        return np.split(positions, self.graph.scans[list(self.graph.breaks)])

    def trajectories(self) -> dict[str, Poses]:
        """Poses (n, 4, 4) of all scans, by name: ``odometry`` and ``optimized``."""
        found = {"odometry": self.track.poses}
        if self.optimized is not None:
            found["optimized"] = corrected(self.track, self.graph, self.optimized.poses)
        return found

    def aligned(self) -> dict[str, Poses]:
        """The `trajectories` in the world of the truth, or in their own without truth."""
        if self.truth is None:
            return self.trajectories()
        known = self.truth.known
        true = self.truth.poses[known]
        return {
            name: aligning(poses[known], true) @ poses
            for name, poses in self.trajectories().items()
        }

    def errors(self) -> dict[str, TrajectoryErrors]:
        """Errors of each trajectory at the scans whose truth is known; empty without truth."""
        if self.truth is None:
            return {}
        known = self.truth.known
        true = self.truth.poses[known]
        found = {}
        for name, poses in self.trajectories().items():
            lengths = (relative_error(poses[known], true, metres) for metres in LENGTHS)
            relative = [one for one in lengths if one is not None]
            found[name] = TrajectoryErrors(absolute_error(poses[known], true), relative)
        return found


def truth_at(track: Track, trajectory: Trajectory, tolerance_s: float = 0.1) -> Truth:
    """The true poses at the stamps of a track, interpolated.

    Raises DataError for a track without stamps, and for less than 3 scans with a pose.
    """
    if track.stamps is None:
        raise DataError(
            "poses: the scans have no stamps, expected them for poses with stamps: scans of a bag, "
            "or files named by nanoseconds since 1970"
        )
    poses, known = trajectory.interpolate(track.stamps, tolerance_s)
    if np.count_nonzero(known) < 3:
        raise DataError(
            f"poses: {np.count_nonzero(known)} of {len(known)} scans have a pose within "
            f"{tolerance_s:g} s, expected at least 3: poses of the same drive and clock"
        )
    return Truth(poses, known)


def result_json(result: DriveResult) -> str:
    """`result_values` as JSON, an object of the schema ``loops``."""
    return json_text("loops", result_values(result), indent=1)


def result_values(result: DriveResult) -> dict[str, Any]:
    """All that is known of the keyframes and loops, and the errors.

    ``scans`` are the numbers of the keyframes' scans in the drive, ``rows`` their rows in the
    trajectories, ``stamps`` nanoseconds or null. A ratio without a rival is null.
    """
    track, graph = result.track, result.graph
    return {
        "drive": track.name,
        "poses": "odometry" if track.by_odometry else "given",
        "ground_z": result.ground_z,
        "scans": track.scans[graph.scans].tolist(),
        "rows": graph.scans.tolist(),
        "stamps": None if graph.stamps is None else graph.stamps.tolist(),
        "names": [track.names[row] for row in graph.scans],
        "breaks": list(graph.breaks),
        "deskewed": track.deskewed,
        "doubts": list(track.doubts),
        "loops": [_loop(result, k) for k in range(len(graph.loops))],
        "errors": {name: _errors(errors) for name, errors in result.errors().items()},
    }


def _loop(result: DriveResult, k: int) -> dict[str, Any]:
    loop, optimized = result.graph.loops[k], result.optimized
    return {
        "keyframe": loop.keyframe,
        "earlier": loop.earlier,
        "x": loop.x,
        "y": loop.y,
        "yaw": loop.yaw,
        "transform": loop.transform.tolist(),
        "fit": loop.fit,
        "ratio": loop.ratio if np.isfinite(loop.ratio) else None,
        "inliers": loop.inliers,
        "refined": loop.refined,
        "accepted": None if optimized is None else bool(optimized.accepted[k]),
    }


def _errors(errors: TrajectoryErrors) -> dict[str, Any]:
    return {
        "absolute": errors.absolute._asdict(),
        "relative": [one._asdict() for one in errors.relative],
    }
