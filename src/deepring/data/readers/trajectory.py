"""Ground-truth trajectories: stamped poses, interpolated at the scans' stamps."""

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from deepring.data.readers.listing import Listing
from deepring.data.session import SkippedScans
from deepring.errors import DeepringError

NANOSECONDS = 1_000_000_000


class Trajectory:
    """Poses along one drive, ascending in time.

    ``stamps`` are (n,) int64 nanoseconds, ``poses`` (n, 4, 4) float64 rigid transforms,
    ``source`` names where they come from in error messages. Rows that hold NaN or infinity, no
    rotation, or a negative stamp are dropped; rows out of order are sorted back into place; of
    rows with equal stamps the first in the file is kept. ``bad_poses`` counts all of these.
    Raises DeepringError where no row is usable.
    """

    def __init__(self, stamps: ArrayLike, poses: ArrayLike, source: Path | str = "trajectory"):
        times = np.asarray(stamps, dtype=np.int64)
        rows = np.asarray(poses, dtype=np.float64)
        if rows.shape != (*times.shape, 4, 4) or times.ndim != 1:
            raise ValueError(
                f"{source}: stamps {times.shape} and poses {rows.shape}; expected (n,), (n, 4, 4)"
            )
        usable = rigid_rows(rows) & (times >= 0)
        if not usable.any():
            raise DeepringError(
                f"{source}: none of its {len(times)} pose rows is usable; expected finite "
                "numbers and rotation matrices. Fetch the file again"
            )
        kept = times[usable]
        order = np.argsort(kept, kind="stable")
        late = kept < np.maximum.accumulate(kept)
        repeated = np.zeros(len(kept), dtype=bool)
        repeated[order[1:]] = np.diff(kept[order]) == 0
        order = order[~repeated[order]]
        self.stamps: NDArray[np.int64] = kept[order]
        self.poses: NDArray[np.float64] = rows[np.flatnonzero(usable)[order]]
        self.bad_poses = int(np.sum(~usable) + np.sum(late | repeated))

    def __len__(self) -> int:
        return len(self.stamps)

    def interpolate(
        self, stamps: ArrayLike, tolerance_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Poses (m, 4, 4) at ``stamps`` (m,) int64 nanoseconds, and a mask (m,) of the valid ones.

        A stamp is valid when a pose has exactly that stamp, or when **both** the last pose before
        and the first pose after it lie within ``tolerance_s`` seconds. So nothing is extrapolated,
        and no gap longer than twice the tolerance is bridged. Rotations are interpolated along
        the shortest arc (slerp), translations linearly; invalid rows are NaN.
        """
        tolerance = np.int64(round(checked_tolerance(tolerance_s) * NANOSECONDS))
        times = np.asarray(stamps, dtype=np.int64)
        after = np.minimum(np.searchsorted(self.stamps, times), len(self) - 1)
        exact = self.stamps[after] == times
        before = np.where(exact, after, np.maximum(after - 1, 0))
        since, until = times - self.stamps[before], self.stamps[after] - times
        # Ahead of the first pose `since` is negative, behind the last one `until` is.
        near = (since >= 0) & (since <= tolerance) & (until >= 0) & (until <= tolerance)
        valid = np.asarray(exact | near, dtype=np.bool_)
        poses = np.full((len(times), 4, 4), np.nan)
        if valid.any():
            share = since[valid] / np.maximum((since + until)[valid], 1)
            poses[valid] = _between(self.poses[before[valid]], self.poses[after[valid]], share)
        return poses, valid


def _between(
    start: NDArray[np.float64], end: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses (k, 4, 4) a ``share`` (k,) in [0, 1] of the way from ``start`` to ``end``."""
    first = Rotation.from_matrix(start[:, :3, :3])
    turn = (first.inv() * Rotation.from_matrix(end[:, :3, :3])).as_rotvec()
    poses = start.copy()
    poses[:, :3, :3] = (first * Rotation.from_rotvec(share[:, None] * turn)).as_matrix()
    poses[:, :3, 3] += share[:, None] * (end[:, :3, 3] - start[:, :3, 3])
    return poses


def rigid_rows(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask (n,) of the poses (n, 4, 4) that are finite, with a rotation to 1 % (files round)."""
    finite = np.isfinite(poses).all(axis=(1, 2))
    # Clipped, so that garbage cannot overflow the product; an entry of 2 is in no rotation.
    rotations = np.clip(np.nan_to_num(poses[:, :3, :3]), -2.0, 2.0)
    product = np.einsum("nij,nkj->nik", rotations, rotations)
    orthonormal = np.abs(product - np.eye(3)).max(axis=(1, 2), initial=0.0) < 0.01
    # A reflection is orthonormal too: the third row must be the cross product of the others.
    third = np.cross(rotations[:, 0], rotations[:, 1])
    proper = np.einsum("ni,ni->n", third, rotations[:, 2]) > 0
    return np.asarray(finite & orthonormal & proper, dtype=np.bool_)


def checked_tolerance(tolerance_s: float) -> float:
    """Return a pose tolerance in seconds if it is one; raises DeepringError otherwise."""
    if not 0 <= tolerance_s <= 3600:  # also refuses NaN
        raise DeepringError(
            f"pose_tolerance = {tolerance_s!r}; expected seconds between 0 and 3600, such as 0.05"
        )
    return float(tolerance_s)


class PosedScans(NamedTuple):
    """The m scans of a listing that have a pose."""

    files: tuple[Path, ...]
    stamps: NDArray[np.int64]  # (m,) nanoseconds
    poses: NDArray[np.float64]  # (m, 4, 4), as the trajectory has them
    skipped: SkippedScans


def match_scans(listing: Listing, trajectory: Trajectory, tolerance_s: float) -> PosedScans:
    """Give each scan of a listing in nanoseconds its pose, and count those that get none.

    Raises DeepringError where no scan gets one.
    """
    poses, valid = trajectory.interpolate(listing.numbers, tolerance_s)
    if not valid.any():
        raise DeepringError(
            f"no pose within {tolerance_s} s of any scan of {listing.files[0].parent}: scans run "
            f"{_span(listing.numbers)}, poses {_span(trajectory.stamps)}. Check that scans and "
            "ground truth are of the same drive, or raise pose_tolerance"
        )
    return PosedScans(
        files=tuple(listing.files[i] for i in np.flatnonzero(valid)),
        stamps=listing.numbers[valid],
        poses=poses[valid],
        skipped=SkippedScans(listing.broken, int(np.sum(~valid)), trajectory.bad_poses),
    )


def _span(stamps: NDArray[np.int64]) -> str:
    return f"from {stamps[0] / NANOSECONDS:.3f} s to {stamps[-1] / NANOSECONDS:.3f} s"


def stamped_rows(columns: int) -> np.dtype:
    """Row type of a pose table: an integer ``stamp``, exact to the nanosecond, and ``values``."""
    # Read as float64, a stamp in nanoseconds since 1970 would be off by up to 128 ns.
    return np.dtype([("stamp", np.int64), ("values", np.float64, (columns,))])


def read_table(path: Path, row: np.dtype, delimiter: str | None, expected: str) -> NDArray:
    """Read a text table without header into (n,) rows of type ``row``.

    ``expected`` says in words what a row holds. Raises DeepringError where a row holds anything
    else, naming the file and the row, or where there is none.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy only warns of an empty file
            return np.loadtxt(path, dtype=row, delimiter=delimiter, ndmin=1)
    except (OSError, ValueError, OverflowError, Warning) as error:
        raise DeepringError(
            f"{path}: cannot be read as a table: {error}. Expected no header and in each row "
            f"{expected}. Fetch the file again, or repair the row"
        ) from error


def poses_from_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) from rows (n, 12): the upper 3x4 of each, row by row."""
    poses = np.zeros((len(rows), 4, 4))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    poses[:, 3, 3] = 1.0
    return poses
