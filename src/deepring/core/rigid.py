"""The rotations and translations of Eq. 2 and 3: matrices, poses, planar yaw; float64."""

import math
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Float64
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
Angle = TypeVar("Angle", float, FloatArray)

#: NED (x forward, y right, z down) to x forward, y left, z up: both y and z change sign.
#: Flipping z alone would make a left-handed frame, in which yaw turns the wrong way.
NED_TO_UP = np.diag([1.0, -1.0, -1.0])


def rotation_from_rpy(
    roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike
) -> Float64[np.ndarray, "*n 3 3"]:
    """R = Rz(yaw) Ry(pitch) Rx(roll), angles in radians; shape (..., 3, 3).

    >>> rotation_from_rpy(0, 0, np.pi / 2).round(3)[:2, :2]  # x forward becomes y to the left
    array([[ 0., -1.],
           [ 1.,  0.]])
    """
    r, p, y = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (roll, pitch, yaw)))
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def pose_from(rotation: ArrayLike, translation: ArrayLike) -> Float64[np.ndarray, "*n 4 4"]:
    """Homogeneous poses (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3).

    >>> pose_from(np.eye(3), [4, 5, 6])[0]
    array([1., 0., 0., 4.])
    """
    rotation = np.asarray(rotation, dtype=np.float64)
    pose = np.zeros((*rotation.shape[:-2], 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = translation
    pose[..., 3, 3] = 1.0
    return pose


def planar_pose(x: float, y: float, yaw: float, z: float = 0.0) -> Float64[np.ndarray, "4 4"]:
    """The level pose (4, 4) of a position, metres, and a heading, radians.

    >>> planar_pose(4, 5, np.pi / 2).round(3)[:2]
    array([[ 0., -1.,  0.,  4.],
           [ 1.,  0.,  0.,  5.]])
    """
    return pose_from(rotation_from_rpy(0.0, 0.0, yaw), [x, y, z])


def moved_points(
    points: Float[np.ndarray, "n 3"], pose: Float64[np.ndarray, "4 4"]
) -> Float64[np.ndarray, "n 3"]:
    """Points (n, 3) of the frame of a pose, in the frame that the pose is in.

    >>> moved_points(np.array([[1.0, 0.0, 7.0]]), planar_pose(4, 5, np.pi / 2)).round(3)
    array([[4., 6., 7.]])
    """
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def yaw_of(pose: ArrayLike) -> Float64[np.ndarray, "*n"]:
    """Counter-clockwise yaw (rad) of poses (..., 4, 4) or rotations (..., 3, 3).

    >>> round(float(yaw_of(rotation_from_rpy(0.1, -0.2, 0.5))), 6)
    0.5
    """
    pose = np.asarray(pose, dtype=np.float64)
    return np.asarray(np.arctan2(pose[..., 1, 0], pose[..., 0, 0]))


def wrap_angle(angle: Angle) -> Angle:
    """The same angle, or angles (n,), in [-π, π), radians.

    >>> round(wrap_angle(1.5 * math.pi) / math.pi, 3)
    -0.5
    """
    return (angle + math.pi) % (2 * math.pi) - math.pi


def yaw_after_turn(yaw: float, turn: float) -> float:
    """Heading of a sensor that sees the points turned by ``turn``, compared with heading ``yaw``.

    Radians, counter-clockwise, in [-π, π). A sensor that turns left sees its surroundings turn
    right: the heading is ``yaw - turn``. The other way round, the turn of the points between two
    headings is ``yaw_after_turn(first, second)``. Only this function converts between the two.

    >>> yaw_after_turn(0.5, 0.25)
    0.25
    """
    return wrap_angle(yaw - turn)


def turn_points(points: Float[np.ndarray, "n 3"], turn: float) -> Float[np.ndarray, "n 3"]:
    """Turn points (n, 3) about z by ``turn`` (rad, counter-clockwise).

    >>> turn_points(np.array([[1.0, 0.0, 7.0]]), math.pi / 2).round(3)
    array([[0., 1., 7.]])
    """
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=points.dtype)
    return points @ rotation.T
