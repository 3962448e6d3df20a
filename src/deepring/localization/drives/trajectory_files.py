"""Trajectories as text: TUM's and KITTI's format."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deepring.data.poses.stamps import NANOSECONDS, seconds_text


def tum_lines(poses: NDArray[np.float64], stamps: NDArray[np.int64] | None) -> Iterator[str]:
    """Poses (n, 4, 4) in TUM's format: seconds x y z qx qy qz qw.

    Stamps (n,) in nanoseconds are written exactly. Without, the seconds are the row's number.
    """
    from scipy.spatial.transform import Rotation

    at = np.arange(len(poses)) * NANOSECONDS if stamps is None else stamps
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    for stamp, pose, turn in zip(at, poses, turns, strict=True):
        yield f"{seconds_text(stamp)} {_numbers((*pose[:3, 3], *turn))}"


def kitti_lines(poses: NDArray[np.float64]) -> Iterator[str]:
    """Poses (n, 4, 4) in KITTI's format: the upper 3 x 4 of each, row by row.

    The poses are those of the scans, x forward and z up, unlike KITTI's own, which are a camera's.
    """
    for pose in poses:
        yield _numbers(pose[:3].ravel())


def _numbers(values: tuple[float, ...] | NDArray[np.float64]) -> str:
    return " ".join(f"{value:.9f}" for value in values)
