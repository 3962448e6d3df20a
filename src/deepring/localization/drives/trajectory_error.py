"""Errors of a trajectory beside the truth: absolute (ATE) and relative (RPE)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from
from deepring.data.spacing import path_lengths
from deepring.errors import DataError

Poses = NDArray[np.float64]

#: Metres of path over which relative errors are taken.
LENGTHS = (10.0, 100.0)


class AbsoluteError(NamedTuple):
    """Distances between the positions of two trajectories, one aligned with the other; metres."""

    rmse: float
    """Root of the mean square."""
    median: float
    largest: float


class RelativeError(NamedTuple):
    """Errors of the motion over stretches of one length."""

    metres: float
    """Path of the truth from the first pose of a stretch to its last."""
    stretches: int
    shift: float
    """Root of the mean square of the shift that is off, metres."""
    turn: float
    """Root of the mean square of the turn that is off, degrees."""


def aligning(estimate: Poses, truth: Poses) -> Poses:
    """The rigid transform (4, 4) that moves positions of (n, 4, 4) poses nearest to the truth's.

    Least squares without scale (Umeyama, Least-Squares Estimation of Transformation Parameters
    Between Two Point Patterns, PAMI 1991). Of positions on one line, the turn about it is any.
    """
    _expect_pairs(estimate, truth)
    moved, fixed = estimate[:, :3, 3], truth[:, :3, 3]
    centre, goal = moved.mean(axis=0), fixed.mean(axis=0)
    u, _, vt = np.linalg.svd((fixed - goal).T @ (moved - centre))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])  # no reflection
    rotation = u @ proper @ vt
    return pose_from(rotation, goal - rotation @ centre)


def absolute_error(estimate: Poses, truth: Poses) -> AbsoluteError:
    """The absolute trajectory error of (n, 4, 4) poses, after `aligning`.

    As in Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012. Raises
    DataError for less than 3 poses, or different numbers of them.
    """
    aligned = aligning(estimate, truth) @ estimate
    distances = np.linalg.norm(aligned[:, :3, 3] - truth[:, :3, 3], axis=1)
    return AbsoluteError(
        float(np.sqrt(np.mean(distances**2))), float(np.median(distances)), float(distances.max())
    )


def relative_error(estimate: Poses, truth: Poses, metres: float) -> RelativeError | None:
    """The relative pose error of (n, 4, 4) poses over stretches of so many metres.

    A stretch begins at every pose i and ends at the first pose j that is ``metres`` of the true
    path later; its error is inv(inv(Q_i) Q_j) inv(P_i) P_j of truth Q and estimate P, as in
    KITTI's odometry benchmark (Geiger et al., CVPR 2012), whose stretches are 100 to 800 m. No
    alignment is needed. None if the path is too short. Raises DataError as `absolute_error`.
    """
    from scipy.spatial.transform import Rotation

    _expect_pairs(estimate, truth)
    path = path_lengths(truth[:, :3, 3])
    ends = np.searchsorted(path, path + metres)
    starts = np.flatnonzero(ends < len(path))
    if not len(starts):
        return None
    ends = ends[starts]
    moved = np.linalg.inv(estimate[starts]) @ estimate[ends]
    expected = np.linalg.inv(truth[starts]) @ truth[ends]
    off = np.linalg.inv(expected) @ moved
    shifts = np.linalg.norm(off[:, :3, 3], axis=1)
    turns = np.degrees(Rotation.from_matrix(off[:, :3, :3]).magnitude())
    return RelativeError(
        metres,
        len(starts),
        float(np.sqrt(np.mean(shifts**2))),
        float(np.sqrt(np.mean(turns**2))),
    )


def _expect_pairs(estimate: Poses, truth: Poses) -> None:
    if estimate.shape != truth.shape or len(truth) < 3:
        raise DataError(
            f"trajectory: {len(estimate)} poses beside {len(truth)} true ones, expected as many, "
            "and at least 3"
        )
