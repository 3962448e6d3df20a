"""Rigid transforms: rotation matrices, poses, planar yaw. float64 throughout."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

#: NED (x forward, y right, z down) to x forward, y left, z up: both y and z change sign.
#: Flipping z alone would make a left-handed frame, in which yaw turns the wrong way.
NED_TO_UP = np.diag([1.0, -1.0, -1.0])


def rotation_from_rpy(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> FloatArray:
    """R = Rz(yaw) Ry(pitch) Rx(roll), angles in radians; shape (..., 3, 3)."""
    r, p, y = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (roll, pitch, yaw)))
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    matrix: FloatArray = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return matrix


def pose_from(rotation: ArrayLike, translation: ArrayLike) -> FloatArray:
    """Homogeneous poses (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3)."""
    rotation = np.asarray(rotation, dtype=np.float64)
    pose = np.zeros((*rotation.shape[:-2], 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = translation
    pose[..., 3, 3] = 1.0
    return pose


def yaw_of(pose: ArrayLike) -> FloatArray:
    """Counter-clockwise yaw (rad) of poses (..., 4, 4) or rotations (..., 3, 3)."""
    pose = np.asarray(pose, dtype=np.float64)
    return np.arctan2(pose[..., 1, 0], pose[..., 0, 0])


def turn_points(points: NDArray[np.float32], yaw: float) -> NDArray[np.float32]:
    """Turn points (n, 3) about z by ``yaw`` (rad, counter-clockwise)."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=points.dtype)
    turned: NDArray[np.float32] = points @ turn.T
    return turned
