"""Cylindrical voxels of a scan: sectors of azimuth, rings of range, layers of height.

Source: EgoNN (Komorowski et al., RA-L 2021, Sec. III-A) and its repository jac99/Egonn.
"""

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DeepringError

PADDING = int(np.iinfo(np.int16).min)
"""Fills the rows after the last voxel where scans of a batch are padded; no index is this low."""


def sectors_of(degrees: float) -> int:
    """Sectors in a turn; DeepringError where ``degrees`` does not divide 360."""
    sectors = round(360 / degrees) if 0 < degrees <= 360 else 0
    if not sectors or abs(sectors * degrees - 360) > 1e-6:
        raise DeepringError(f"voxels.degrees: {degrees!r}, expected a step that divides 360")
    return sectors


def cylindrical_voxels(
    points: NDArray[np.float32],
    degrees: float = 1.0,
    ring: float = 0.3,
    height: float = 0.2,
) -> NDArray[np.int16]:
    """Occupied voxels (θ, r, z) of a scan, (m, 3) int16, unique and in lexicographic order.

    Sector 0 begins at azimuth -π, behind the sensor, and sectors count counter-clockwise, as in
    EgoNN's code. There the one azimuth +π has a sector of its own; here it falls into sector 0.
    The order of the points does not matter. A scan without points has no voxels.

    Args:
        points: (n, 3) float32, metres.
        degrees: width of a sector; divides 360.
        ring: depth of a ring, metres.
        height: of a layer, metres; layer 0 begins at z = 0.

    Raises:
        DeepringError: a bad step, a coordinate that is not finite or an index beyond int16.
    """
    sectors = sectors_of(degrees)
    for name, step in (("ring", ring), ("height", height)):
        if not 0 < step < np.inf:
            raise DeepringError(f"voxels.{name}: {step!r}, expected a length in metres above 0")
    x, y, z = np.asarray(points, dtype=np.float64).reshape(-1, 3).T
    cells = np.stack([(np.degrees(np.arctan2(y, x)) + 180) / degrees, np.hypot(x, y) / ring, z])
    cells[2] /= height
    if cells.size == 0:
        return np.empty((0, 3), dtype=np.int16)
    # Written so that NaN fails, too.
    if not np.abs(cells).max() < -PADDING:
        raise DeepringError(
            f"points: {cells.shape[1]} points with a coordinate that is not finite or with a voxel "
            f"index of {-PADDING} or more; expected finite metres and larger steps"
        )
    index = np.floor(cells).astype(np.int64)
    index[0] %= sectors
    # One number a voxel sorts much faster than rows of three.
    low = index.min(axis=1)
    extent = index.max(axis=1) - low + 1
    keys = np.unique(np.ravel_multi_index(tuple(index - low[:, None]), tuple(extent)))
    return (np.stack(np.unravel_index(keys, tuple(extent)), axis=1) + low).astype(np.int16)
