"""Trajectories in TUM's format, whose stamps are decimal seconds."""

from pathlib import Path

import numpy as np

from deepring.data.poses.pose_tables import poses_from_quaternions, read_table, stamped_rows
from deepring.data.poses.trajectory import Trajectory


def read_tum(path: Path) -> Trajectory:
    """The trajectory of a file with rows ``stamp x y z qx qy qz qw``; stamps to the nanosecond.

    Raises FileError for a file that is no such table, and DataError as `Trajectory` does.
    """
    row = "stamp x y z qx qy qz qw, separated by blanks"
    rows = read_table(path, stamped_rows(7), None, row, seconds=True)
    stamps = np.asarray(rows["stamp"], dtype=np.int64)
    return Trajectory(stamps, poses_from_quaternions(rows["values"]), path)
