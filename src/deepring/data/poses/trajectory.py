"""Ground-truth trajectories: stamped poses, interpolated at the stamps of scans."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deepring.data.poses.rigid import rigid_rows, rotation_problem
from deepring.data.poses.stamps import NANOSECONDS
from deepring.errors import ConfigError, DataError

#: Share of the rows of a pose file. A few bad rows of many are left out and counted.
LEAST_USABLE = 0.5


class Trajectory:
    """Poses along one drive, ascending in time.

    ``stamps`` are (n,) int64 nanoseconds, ``poses`` (n, 4, 4) float64 rigid transforms,
    ``source`` is their origin in error messages. Rows with NaN or infinity, without a rotation, or
    with a negative stamp are dropped; rows out of order are sorted; of rows with equal stamps the
    first is kept. ``bad_poses`` counts all of these. Raises DataError if less than half of the rows
    are usable.
    """

    def __init__(self, stamps: ArrayLike, poses: ArrayLike, source: Path | str = "trajectory"):
        times = np.asarray(stamps, dtype=np.int64)
        rows = np.asarray(poses, dtype=np.float64)
        if rows.shape != (*times.shape, 4, 4) or times.ndim != 1:
            raise DataError(
                f"{source}: stamps {times.shape} and poses {rows.shape}; expected (n,), (n, 4, 4)"
            )
        usable = rigid_rows(rows) & (times >= 0)
        check_usable(rows, usable, source)
        times = times[usable]
        order = np.argsort(times, kind="stable")
        late = times < np.maximum.accumulate(times)
        repeated = np.zeros(len(times), dtype=bool)
        repeated[order[1:]] = np.diff(times[order]) == 0
        order = order[~repeated[order]]
        self.stamps: NDArray[np.int64] = times[order]
        self.poses: NDArray[np.float64] = rows[np.flatnonzero(usable)[order]]
        self.bad_poses = int(np.sum(~usable) + np.sum(late | repeated))

    def __len__(self) -> int:
        return len(self.stamps)

    def interpolate(
        self, stamps: ArrayLike, tolerance_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Poses (m, 4, 4) at ``stamps`` (m,) int64 nanoseconds, and a mask (m,) of the valid ones.

        A stamp is valid if a pose has exactly that stamp, or if **both** the last pose before and
        the first pose after it are within ``tolerance_s`` seconds: there is no extrapolation, and
        no interpolation across gaps longer than twice the tolerance. Rotations are interpolated
        along the shortest arc (slerp), translations linearly; invalid rows are NaN.
        """
        tolerance = np.int64(round(checked_tolerance(tolerance_s) * NANOSECONDS))
        times = np.asarray(stamps, dtype=np.int64)
        after = np.minimum(np.searchsorted(self.stamps, times), len(self) - 1)
        exact = self.stamps[after] == times
        before = np.where(exact, after, np.maximum(after - 1, 0))
        since, until = times - self.stamps[before], self.stamps[after] - times
        # Before the first pose ``since`` is negative, after the last one ``until`` is.
        near = (since >= 0) & (since <= tolerance) & (until >= 0) & (until <= tolerance)
        valid = np.asarray(exact | near, dtype=np.bool_)
        poses = np.full((len(times), 4, 4), np.nan)
        if valid.any():
            share = since[valid] / np.maximum((since + until)[valid], 1)
            poses[valid] = between(self.poses[before[valid]], self.poses[after[valid]], share)
        return poses, valid


def check_usable(poses: NDArray[np.float64], usable: NDArray[np.bool_], source: Path | str) -> None:
    """Raise DataError if no pose (n, 4, 4) is usable (n,), or fewer than `LEAST_USABLE` of them."""
    bad = np.flatnonzero(~usable)
    if not usable.any() or len(bad) > (1 - LEAST_USABLE) * len(usable):
        reason = f" ({rotation_problem(poses[bad[0]])})" if len(bad) else ""
        which = f"{len(bad)} of its {len(usable)}" if usable.any() else f"none of its {len(usable)}"
        verb = "pose rows are not usable" if usable.any() else "pose rows is usable"
        raise DataError(
            f"{source}: {which} {verb}{reason}; expected finite numbers and rotations. Fetch the "
            "file again"
        )


def between(
    start: NDArray[np.float64], end: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses (k, 4, 4) a ``share`` (k,) in [0, 1] of the way from ``start`` to ``end``."""
    from scipy.spatial.transform import Rotation

    first = Rotation.from_matrix(start[:, :3, :3])
    turn = (first.inv() * Rotation.from_matrix(end[:, :3, :3])).as_rotvec()
    poses = start.copy()
    poses[:, :3, :3] = (first * Rotation.from_rotvec(share[:, None] * turn)).as_matrix()
    poses[:, :3, 3] += share[:, None] * (end[:, :3, 3] - start[:, :3, 3])
    return poses


def checked_tolerance(tolerance_s: float) -> float:
    """Return a pose tolerance in seconds if it is valid. Raises ConfigError otherwise."""
    if not 0 <= tolerance_s <= 3600:  # also rejects NaN
        raise ConfigError(
            f"pose_tolerance: {tolerance_s!r}, expected seconds between 0 and 3600, e.g. 0.05"
        )
    return float(tolerance_s)
