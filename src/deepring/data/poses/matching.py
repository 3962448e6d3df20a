"""Matches the scans of a folder with poses."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.poses.stamps import NANOSECONDS
from deepring.data.poses.trajectory import Trajectory
from deepring.data.scans.listing import Listing
from deepring.data.session import SkippedScans
from deepring.errors import DataError


class PosedScans(NamedTuple):
    """The m scans of a listing that have a pose."""

    files: tuple[Path, ...]
    stamps: NDArray[np.int64]  # (m,) nanoseconds
    poses: NDArray[np.float64]  # (m, 4, 4), interpolated on the trajectory
    skipped: SkippedScans


def match_scans(listing: Listing, trajectory: Trajectory, tolerance_s: float) -> PosedScans:
    """Match each scan of a listing in nanoseconds with its pose, and count those without one.

    Raises DataError if no scan has a pose.
    """
    poses, valid = trajectory.interpolate(listing.numbers, tolerance_s)
    if not valid.any():
        raise DataError(
            f"no pose within {tolerance_s} s of any scan of {listing.files[0].parent}: scans run "
            f"{_span(listing.numbers)}, poses {_span(trajectory.stamps)}. Check that scans and "
            "ground truth are from the same drive, or raise pose_tolerance"
        )
    return PosedScans(
        files=tuple(listing.files[i] for i in np.flatnonzero(valid)),
        stamps=listing.numbers[valid],
        poses=poses[valid],
        skipped=SkippedScans(listing.broken, int(np.sum(~valid)), trajectory.bad_poses),
    )


def _span(stamps: NDArray[np.int64]) -> str:
    return f"from {stamps[0] / NANOSECONDS:.3f} s to {stamps[-1] / NANOSECONDS:.3f} s"
