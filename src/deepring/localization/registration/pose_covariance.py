"""Covariance of a registered pose, from the surfaces that hold it, and what none of them holds.

The inverse of GICP's Hessian is no covariance of the pose. It takes every point for a measurement
of its own, though the points of one surface err together, and its regularised Gaussians hold a pose
along a wall, where nothing does. Here a match counts along its surface's normal alone, and:

- the matches of one cell of `CELL` metres count as one;
- information is the product of the normals of *both* scans, whose errors are independent: noise
  that tilts normals is none on average, and what is left has to be significant;
- the spread of the gaps along the normals is the noise, times `SCALE`, which was fixed where true
  poses are known (`benchmarks/pose_covariance.py`).

The covariance is of (x, y, z, roll, pitch, yaw), metres and radians: the error of the position, and
the small rotation that takes the estimated orientation to the true one, both along the axes of the
frame that the pose is in, not of the sensor. It is what ROS's PoseWithCovariance holds.
`in_sensor_frame` gives it for pose · Exp(error), as pose graphs have it. The map is taken as it is:
errors of its own poses come on top.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import FloatArray
from deepring.localization.registration.surfaces import Surfaces, lever_rows

#: Side of the cells whose matches count as one, metres.
CELL = 4.0

#: Factor of standard deviations, fixed on simulated worlds (`benchmarks/pose_covariance.py`).
SCALE = 1.0

#: Arm at which a rotation is compared with a shift, metres.
ARM = 10.0

#: Standard deviation from which a direction counts as unobservable, metres (rotations at `ARM`).
LOOSE = 0.5

#: Side of the cells whose normals err apart, metres.
_SMALL = 1.0

#: Standard errors by which information has to exceed nothing.
_SIGNIFICANT = 2.0

#: Slope that both scans may share where there is none, by what lies at the surfaces' borders.
_FLAT = 0.02

_ARMS = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM])


@dataclass(frozen=True)
class PoseUncertainty:
    """How well a pose is known."""

    covariance: FloatArray
    """(6, 6) of x, y, z, roll, pitch, yaw along the frame's axes, metres and radians."""
    unobservable: FloatArray
    """(k, 6) unit directions, rotations times `ARM` metres, that no surface holds: their standard
    deviation exceeds `LOOSE`."""


def pose_uncertainty(
    surfaces: Surfaces, shift: float, turn: float, scale: float = SCALE
) -> PoseUncertainty:
    """How well shared surfaces hold a pose.

    Args:
        surfaces: those that the two scans share, at the end of the registration.
        shift: standard deviation of the position before, metres; none is larger after.
        turn: of the rotation, radians.
        scale: factor of the noise's standard deviation.
    """
    information = np.diag(1 / np.array([shift] * 3 + [turn * ARM] * 3) ** 2)
    if len(surfaces.gaps):
        noise = scale * surfaces.noise
        information += _information(surfaces) / noise**2
    covariance = np.linalg.inv(information)
    deviations, directions = np.linalg.eigh((covariance + covariance.T) / 2)
    loose = deviations > LOOSE**2
    return PoseUncertainty(covariance / np.outer(_ARMS, _ARMS), directions[:, loose].T[::-1].copy())


def turned(covariance: FloatArray, rotation: FloatArray) -> FloatArray:
    """A covariance (6, 6) along the axes of a frame that the rotation (3, 3) takes into another."""
    both = np.kron(np.eye(2), rotation)
    return np.asarray(both @ covariance @ both.T)


def in_sensor_frame(covariance: FloatArray, pose: FloatArray) -> FloatArray:
    """The covariance of ``error`` in pose (4, 4) · Exp(error): along the sensor's own axes."""
    return turned(covariance, pose[:3, :3].T)


def direction_name(direction: FloatArray) -> str:
    """What an unobservable direction (6,) is called.

    >>> direction_name(np.array([0.0, -1, 0, 0, 0, 0.2]))
    'along 90°'
    >>> direction_name(np.array([0.0, 0, 0, 0, 0.1, 0.9]))
    'yaw'
    """
    if np.linalg.norm(direction[:3]) < np.linalg.norm(direction[3:]):
        return ("roll", "pitch", "yaw")[int(np.abs(direction[3:]).argmax())]
    if abs(direction[2]) > np.hypot(direction[0], direction[1]):
        return "height"
    return f"along {math.degrees(math.atan2(direction[1], direction[0])) % 180:.0f}°"


def _cell_information(surfaces: Surfaces, side: float) -> FloatArray:
    """What each cell says for a noise of 1 m: (cells, 6, 6), rotations times `ARM`."""
    rows, others = (lever_rows(normals, surfaces.arms) / _ARMS for normals in surfaces.normals)
    products = (surfaces.weights[:, None] * rows)[:, :, None] * others[:, None, :]
    keys = np.floor(surfaces.points / side).astype(np.int64)
    _, cell, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    sums: NDArray[np.float64] = np.zeros((len(counts), 6, 6))
    np.add.at(sums, cell.ravel(), products + products.transpose(0, 2, 1))
    return sums / (2 * counts[:, None, None])


def _information(surfaces: Surfaces) -> FloatArray:
    """All cells' information (6, 6), along each eigenvector the share that exceeds its error.

    The error is told by small cells: normals err apart where surfaces are off together.
    """
    every = _cell_information(surfaces, CELL).sum(axis=0)
    values, directions = np.linalg.eigh(every)
    small = _cell_information(surfaces, _SMALL)
    each = np.einsum("iv,cij,jv->cv", directions, small, directions)
    error = _SIGNIFICANT * np.sqrt((each**2).sum(axis=0)) + len(each) * _FLAT**2
    share = np.clip(1 - error / np.maximum(each.sum(axis=0), 1e-12), 0, 1)
    return np.asarray((directions * np.maximum(values, 0) * share) @ directions.T)
