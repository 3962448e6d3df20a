"""A loop graph: keyframes of a drive, and the loops among them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import yaw_of
from deepring.data.session import Session


@dataclass(frozen=True, eq=False)
class Loop:
    """Pose of a keyframe in the frame of an earlier one."""

    keyframe: int
    earlier: int
    transform: NDArray[np.float64]
    """(4, 4), earlier <- keyframe. From an alignment of images it is planar: height, roll and pitch
    are 0, which is right to a metre and some degrees."""
    fit: float
    ratio: float
    inliers: float | None = None
    """Share of points that match after refinement; None without refinement."""
    refined: bool = False
    """Whether the transform is refined; where refinement failed, it is the alignment's."""
    covariance: NDArray[np.float64] | None = None
    """(6, 6) of the error inv(transform) @ truth in the keyframe's frame: x, y, z in metres, then
    rotation vector in radians. None if the registration does not tell."""

    @property
    def x(self) -> float:
        """Metres, of the keyframe's sensor in the earlier one's frame."""
        return float(self.transform[0, 3])

    @property
    def y(self) -> float:
        """Metres, likewise."""
        return float(self.transform[1, 3])

    @property
    def yaw(self) -> float:
        """Heading of the keyframe in the earlier one's frame, radians in [-π, π]."""
        return float(yaw_of(self.transform))


@dataclass(frozen=True, eq=False)
class LoopGraph:
    """Keyframes of a drive and the loops among them."""

    scans: NDArray[np.int64]
    """(n,) numbers of the keyframes in their session, or in the `Track` of the odometry."""
    poses: NDArray[np.float64]
    """(n, 4, 4) poses of the session or the odometry, world <- scan."""
    stamps: NDArray[np.int64] | None
    """(n,) nanoseconds, or None."""
    loops: list[Loop]
    breaks: tuple[int, ...] = ()
    """Keyframes before which the odometry was lost: the motion from the one before is not known."""


@dataclass(frozen=True, eq=False)
class Track:
    """The scans of a drive that are used, with their poses."""

    name: str
    scans: NDArray[np.int64]
    """(n,) numbers in the order of the drive, from 0."""
    names: Sequence[str]
    """(n,) of files, or of a bag with stamps."""
    poses: NDArray[np.float64]
    """(n, 4, 4) world <- scan; the world of odometry is the first scan's frame."""
    stamps: NDArray[np.int64] | None
    """(n,) nanoseconds, or None if a scan has none."""
    by_odometry: bool = False
    deskewed: int = 0
    """Scans whose points had times."""
    doubts: tuple[str, ...] = ()
    """What its user should know, a line each."""


def track_of(session: Session) -> Track:
    """All scans of a session with the poses that it has."""
    names = [file.name for file in session.files]
    return Track(session.name, np.arange(len(session)), names, session.poses, session.stamps)
