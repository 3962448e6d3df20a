"""A path: the positions of a file of poses in TUM's or KITTI's format."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.poses.pose_tables import read_table, stamped_rows
from deepring.errors import FileError
from deepring.io.text import read_text

_KITTI = np.dtype([("values", np.float64, (12,))])
_ROWS = "stamp x y z qx qy qz qw (TUM), or 12 numbers, a 3x4 pose row by row (KITTI)"


def read_path(path: Path | str) -> NDArray[np.float64]:
    """Positions (n, 3), metres, of the poses of a file, in the file's order.

    Rows have 8 numbers (TUM) or 12 (KITTI), separated by blanks; lines that begin with # are
    comments. Rotations are not looked at. Raises FileError for another file, and for a position
    that is not finite.
    """
    path = Path(path)
    columns = _columns(path)
    if columns == 12:
        values = read_table(path, _KITTI, None, _ROWS)["values"][:, [3, 7, 11]]
    else:
        values = read_table(path, stamped_rows(7), None, _ROWS, seconds=True)["values"][:, :3]
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        raise FileError(
            f"{path}: the position of pose {bad[0] + 1} of {len(values)} is not finite ({len(bad)} "
            "are not); expected metres: remove these rows"
        )
    return np.asarray(values, dtype=np.float64)


def _columns(path: Path) -> int:
    """Numbers in the first row that is no comment."""
    if not path.is_file():
        raise FileError(f"{path}: no such file; expected poses, in each row {_ROWS}")
    for line in read_text(path, f"poses, in each row {_ROWS}").splitlines():
        if values := line.partition("#")[0].split():
            return len(values)
    return 0
