"""The frame of one map in another, from places that were located, some of them wrongly."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import wrap_angle
from deepring.errors import DataError

#: Errors up to which a place agrees with a frame, metres and radians.
METRES, RADIANS = 2.0, math.radians(5.0)

#: Places that have to agree, their share of those that were located, and how far apart they have to
#: lie, metres. Fewer agree by chance, and the heading of a frame needs a length.
LEAST, SHARE, APART = 5, 0.5, 20.0

#: Error of a single place's heading, radians: a frame from it alone is off by this much per metre.
_LEVER = math.radians(2.0)


class PlanarFrame(NamedTuple):
    """A frame in another one: turned about z by ``yaw``, then shifted."""

    x: float
    """Metres."""
    y: float
    yaw: float
    """Radians."""

    def applied(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Planar poses (n, 3) of this frame, x, y and yaw, in the other one."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        x = self.x + cosine * poses[:, 0] - sine * poses[:, 1]
        y = self.y + sine * poses[:, 0] + cosine * poses[:, 1]
        return np.column_stack([x, y, poses[:, 2] + self.yaw])


def common_frame(
    poses: NDArray[np.float64], located: NDArray[np.float64]
) -> tuple[PlanarFrame, NDArray[np.bool_]]:
    """The frame with which the most places agree, and which do.

    Each place alone gives a frame. The one with which the most others agree, further away less
    strictly, is fitted to these by least squares, again and again until the same ones agree to
    `METRES` and `RADIANS`.

    Args:
        poses: (n, 3) of the places in their own frame: x, y, yaw; metres and radians.
        located: (n, 3) of the same places, as they were located in the other frame.

    Raises DataError unless `LEAST` and `SHARE` of the places agree and lie `APART`.
    """
    if len(poses) < LEAST:
        raise DataError(f"{len(poses)} places are located, expected at least {LEAST}")
    agree = max((_near(poses, located, k) for k in range(len(poses))), key=np.count_nonzero)
    for _ in range(len(poses)):
        frame = _least_squares(poses[agree], located[agree])
        before, agree = agree, _agreeing(frame, poses, located)
        if np.array_equal(before, agree) or not agree.any():
            break
    count, least = int(agree.sum()), max(LEAST, math.ceil(SHARE * len(poses)))
    if count < least:
        raise DataError(
            f"{count} of {len(poses)} located places agree on where the other map lies, expected "
            f"at least {least}"
        )
    size = float(np.ptp(poses[agree, :2], axis=0).max())
    if size < APART:
        raise DataError(
            f"the {count} places that agree lie within {size:.0f} m, expected at least "
            f"{APART:g} m: their frame's heading is uncertain"
        )
    return frame, agree


def _near(poses: NDArray[np.float64], located: NDArray[np.float64], k: int) -> NDArray[np.bool_]:
    """Which places agree with the frame of place ``k`` alone."""
    yaw = float(located[k, 2] - poses[k, 2])
    turned = PlanarFrame(0.0, 0.0, yaw).applied(poses[k : k + 1])[0]
    x, y = located[k, :2] - turned[:2]
    frame = PlanarFrame(float(x), float(y), yaw)
    away = np.linalg.norm(poses[:, :2] - poses[k, :2], axis=1)
    return _agreeing(frame, poses, located, METRES + _LEVER * away)


def _agreeing(
    frame: PlanarFrame,
    poses: NDArray[np.float64],
    located: NDArray[np.float64],
    metres: float | NDArray[np.float64] = METRES,
) -> NDArray[np.bool_]:
    expected = frame.applied(poses)
    away = np.linalg.norm(expected[:, :2] - located[:, :2], axis=1)
    turned = np.abs(wrap_angle(expected[:, 2] - located[:, 2]))
    return (away < metres) & (turned < RADIANS)


def _least_squares(poses: NDArray[np.float64], located: NDArray[np.float64]) -> PlanarFrame:
    """The frame that moves the positions closest to where they were located, and nearly their
    headings: each counts as a position `_ARM` metres ahead."""
    here, there = (_with_arms(values) for values in (poses, located))
    middle, target = here.mean(axis=0), there.mean(axis=0)
    a, b = here - middle, there - target
    yaw = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    x, y = target - PlanarFrame(0.0, 0.0, yaw).applied(np.array([[*middle, 0.0]]))[0, :2]
    return PlanarFrame(float(x), float(y), wrap_angle(yaw))


#: Metres ahead of a place that its heading is worth: half a metre for half a degree.
_ARM = 50.0


def _with_arms(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    ahead = _ARM * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return np.concatenate([poses[:, :2], poses[:, :2] + ahead])
