"""How the poses of a drive move: tilt, slope of the path, and direction of motion in the scans."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Metres. Shorter legs of a path are mostly noise; between the ends of longer ones it may turn.
LEG, LONGEST_LEG = 2.0, 20.0

#: Degrees. Vehicles and robots tilt by a few degrees, a LiDAR carried by hand by up to some 30.
#: Beyond the second, the scans or the motion lie on their side.
MOST_TILT, UNUSABLE_TILT = 35.0, 60.0
#: The path in the plane as a share of that in space: 0.98 on a slope of 20 %, 0.82 on stairs, and
#: 0 where the plane is not horizontal.
LEAST_PLANAR, UNUSABLE_PLANAR = 0.8, 0.6
#: Degrees between the plane of the motion and the horizontal.
MOST_SLOPE = 30.0
#: Metres of path that a check of motion takes at least.
LEAST_PATH = 20.0
#: Entries of R Rᵀ differ from the identity by less, whatever the rounding of the file.
NEARLY = 0.03

Poses = NDArray[np.float64]
"""(n, 4, 4), world <- scan."""


@dataclass(frozen=True)
class Motion:
    """Figures about the motion of one drive. What cannot be measured is None."""

    tilt: float
    """Degrees between the scans' z and the world's, median."""
    step: float
    """Metres in space between neighbouring poses, median; 0 for a single pose."""
    path: float
    """Metres of path in space, in legs of 2 to 20 m."""
    planar: float | None
    """Path in the plane as a share of that in space."""
    normal: NDArray[np.float64] | None
    """(3,) unit direction in which positions vary least; None for a path without a plane."""
    turning: float | None
    """How far the direction of the path varies: 0 for a straight path, 1 for a closed one."""
    forward: float | None
    """How constant the direction of motion is in the scans' frame: 1 if it is always the same."""

    @property
    def off_plane(self) -> float:
        """Degrees between the plane of the motion and the horizontal; 0 if it has no plane."""
        return 0.0 if self.normal is None else _degrees(abs(float(self.normal[2])))


def measurable_rows(poses: Poses) -> NDArray[np.bool_]:
    """Mask (n,) of the poses that are numbers of at most 1e12 m and nearly rotations."""
    finite = np.asarray((np.abs(poses) < 1e12).all(axis=(1, 2)))  # False for NaN
    rotations = np.where(finite[:, None, None], poses[:, :3, :3], 0.0).clip(-2, 2)
    product = np.einsum("nij,nkj->nik", rotations, rotations)
    near = (np.abs(product - np.eye(3)) < NEARLY).all(axis=(1, 2))
    return np.asarray(finite & near, dtype=np.bool_)


def measurable(poses: Poses) -> bool:
    """Whether all poses are `measurable_rows`."""
    return bool(measurable_rows(poses).all())


def measure_motion(poses: Poses) -> Motion:
    """Measure the motion of poses (n, 4, 4), n > 0."""
    tilt = _degrees(float(np.median(poses[:, 2, 2])))
    positions = poses[:, :3, 3] - poses[0, :3, 3]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    step = float(np.median(steps)) if len(steps) else 0.0
    start, end = _legs(positions)
    legs = positions[end] - positions[start]
    lengths = np.linalg.norm(legs, axis=1)
    path = float(lengths.sum())
    if not len(legs):
        return Motion(tilt, step, path, None, None, None, None)
    flat = np.hypot(legs[:, 0], legs[:, 1])
    return Motion(
        tilt,
        step,
        path,
        planar=float(flat.sum() / path),
        normal=_normal(positions),
        turning=1 - _constancy(legs[:, 0], legs[:, 1]),
        forward=_forward(poses[:, :3, :3], start, end, legs),
    )


def _legs(positions: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last index of each leg: the next position at least `LEG` metres away."""
    kept = [0]
    x, y, z = positions[0].tolist()
    for k, (u, v, w) in enumerate(positions.tolist()):
        if (u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2 >= LEG**2:
            kept.append(k)
            x, y, z = u, v, w
    start, end = np.array(kept[:-1], dtype=np.intp), np.array(kept[1:], dtype=np.intp)
    near = np.linalg.norm(positions[end] - positions[start], axis=1) <= LONGEST_LEG
    return start[near], end[near]


def _normal(positions: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Direction of least variance; None where the second direction varies hardly more."""
    _, sizes, directions = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)
    if len(sizes) < 3:
        return None
    spread = sizes / np.sqrt(len(positions))
    # A plane: some metres wide, and several times wider than thick.
    if spread[1] < 3.0 or spread[1] < 4 * spread[2]:
        return None
    return np.asarray(directions[2], dtype=np.float64)


def _forward(
    rotations: NDArray[np.float64],
    start: NDArray[np.intp],
    end: NDArray[np.intp],
    legs: NDArray[np.float64],
) -> float | None:
    """Constancy of the legs' directions, each in the mean of the scans' frames at its ends."""
    first = np.einsum("nji,nj->ni", rotations[start], legs)
    last = np.einsum("nji,nj->ni", rotations[end], legs)
    mean = (first + last)[:, :2]
    lengths = np.linalg.norm(mean, axis=1)
    clear = lengths > 1e-9
    if not clear.any():
        return None
    sizes = np.linalg.norm(legs[clear], axis=1) / lengths[clear]
    return _constancy(*(mean[clear] * sizes[:, None]).T)


def _constancy(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Length of the sum of vectors as a share of the sum of their lengths."""
    total = float(np.hypot(x, y).sum())
    return min(1.0, float(np.hypot(x.sum(), y.sum())) / total) if total else 1.0


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def axis_problems(motion: Motion) -> list[tuple[bool, str]]:
    """What is implausible about a motion, each with whether it makes the poses unusable."""
    problems = []
    if motion.tilt > MOST_TILT:
        text = f"scans are tilted by {motion.tilt:.0f}° in half of the poses"
        problems.append((motion.tilt > UNUSABLE_TILT, f"{text}, expected at most {MOST_TILT:.0f}°"))
    if motion.path < LEAST_PATH or motion.planar is None:
        return problems
    if motion.planar < LEAST_PLANAR:
        flat = motion.planar * motion.path
        text = f"the path is {flat:.0f} m long in the plane and {motion.path:.0f} m in space"
        problems.append((motion.planar < UNUSABLE_PLANAR, f"{text}, expected nearly the same"))
    elif motion.off_plane > MOST_SLOPE:
        text = f"the plane of the motion is tilted by {motion.off_plane:.0f}°"
        problems.append((motion.off_plane > UNUSABLE_TILT, f"{text}, expected z to be up"))
    return problems


class Reading(NamedTuple):
    """Another way to read the same numbers."""

    name: str
    """What the poses would be, after "read as"."""
    advice: str
    read: Callable[[Poses], Poses]


#: A camera's axes (x right, y down, z forward) to those of a LiDAR (x forward, y left, z up).
FROM_CAMERA = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)

_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def _of_camera(poses: Poses) -> Poses:
    return np.asarray(FROM_CAMERA @ poses @ FROM_CAMERA.T)


def inverse_poses(poses: Poses) -> Poses:
    """The inverse of each rigid pose (n, 4, 4)."""
    inverse = poses.copy()
    inverse[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    inverse[:, :3, 3] = -np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3])
    return inverse


def _scalar_first(poses: Poses) -> Poses:
    from scipy.spatial.transform import Rotation

    turned = poses.copy()
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    turned[:, :3, :3] = Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_matrix()
    return turned


def opposite_turns(poses: Poses) -> Poses:
    """The poses with inverse rotations."""
    turned = poses.copy()
    turned[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    return turned


READINGS = (
    Reading(
        "a camera's, x right, y down, z forward",
        "give the LiDAR's pose in the camera (KITTI: Tr in calib.txt; custom drives: "
        "sensor_in_body, and world_up: sensor)",
        _of_camera,
    ),
    Reading(
        "inverses (scan <- world)",
        "invert the poses: expected are those of the scans in the world",
        inverse_poses,
    ),
    Reading(
        "quaternions with w first",
        "write quaternions as qx qy qz qw",
        _scalar_first,
    ),
    Reading(
        "poses with inverse rotations",
        "invert the rotations, or the sign of the yaw, or swap x and y back: expected are "
        "rotations scan to world, counter-clockwise positive, with z up",
        opposite_turns,
    ),
    Reading(
        "poses in a world with z down",
        "turn y and z of the poses (custom drives: world_up: -z)",
        lambda poses: np.asarray(_DOWN @ poses),
    ),
    Reading(
        "poses of scans with z down",
        "turn y and z of the scans (custom drives: up: -z)",
        lambda poses: np.asarray(poses @ _DOWN),
    ),
)
