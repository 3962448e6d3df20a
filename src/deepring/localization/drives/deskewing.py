"""Deskewing: where the points of a sweep would be, had the sensor stood still at its stamp."""

import numpy as np
from numpy.typing import NDArray

from deepring.data.session import Points

#: Moments of a sweep. The motion between two neighbours is less than a millimetre and 0.05° on
#: any vehicle: a sweep moves it by less than 4 m and 10°.
MOMENTS = 256


def deskewed(points: Points, times: NDArray[np.float64], motion: NDArray[np.float64]) -> Points:
    """Points (n, 3) float32 in the frame of the sensor at its stamp, at a constant velocity.

    Args:
        points: (n, 3) float32 metres, each in the sensor's frame when it was measured.
        times: (n,) seconds from the stamp.
        motion: (4, 4), pose of the sensor one second after the stamp in its frame at the stamp.
            Turned and shifted in proportion to the time: p' = R(t w) p + t v, with w the rotation
            vector and v the shift.
    """
    from scipy.spatial.transform import Rotation

    low, high = float(times.min()), float(times.max())
    moments = np.linspace(low, high, MOMENTS)
    nearest = np.rint((times - low) / max(high - low, 1e-9) * (MOMENTS - 1)).astype(np.intp)
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    turns = Rotation.from_rotvec(moments[:, None] * turn).as_matrix().astype(np.float32)
    shifts = (moments[:, None] * motion[:3, 3]).astype(np.float32)
    moved: Points = np.einsum("nij,nj->ni", turns[nearest], points) + shifts[nearest]
    return moved


def motion_over(motion: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The motion (4, 4) over a ``share`` of the time of another, at the same velocity.

    Velocity is the shift in the first frame and the rotation vector, each over the time.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec() * share
    part = np.eye(4)
    part[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    part[:3, 3] = motion[:3, 3] * share
    return part
