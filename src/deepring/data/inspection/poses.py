"""Whether the poses of a session can be those of its scans."""

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.finding import Finding
from deepring.data.inspection.motion import (
    LEAST_PATH,
    READINGS,
    Motion,
    Reading,
    axis_problems,
    measurable,
    measurable_rows,
    measure_motion,
)
from deepring.data.inspection.overlays import check_overlays
from deepring.data.poses.rigid import rotation_problem
from deepring.data.poses.stamps import NANOSECONDS, stamps_in_names
from deepring.data.session import Session

#: Constancy of the direction of motion in the scans: 0.99 on KITTI, NCLT and MulRan. Platforms that
#: drive sideways or to and fro have less, so that alone it is a doubt only where it is small.
LEAST_FORWARD, CLEARLY_FORWARD, ANY_DIRECTION = 0.8, 0.95, 0.4
#: A path turns enough to tell; see `Motion.turning`.
LEAST_TURNING = 0.2
#: Metres per second.
FASTEST = 70.0
#: Metres. Shorter steps are not held against the speed; longer ones are of no drive, as keyframes
#: come every 1 to 50 m (poses in millimetres are 1000 times as far apart), and of no tunnel.
SHORTEST_JUMP, LONGEST_STEP, FARTHEST_STEP = 5.0, 100.0, 1000.0
#: Metres between all poses of at least so many scans, below which a drive stands still.
STANDING, STANDING_SCANS = 0.5, 10
#: Seconds between the stamps of poses and those in the names of their scans.
MOST_AWAY = 0.2
#: Days from the first to the last scan.
LONGEST_DAYS = 30.0
#: Share of the scans without a pose, and of equal neighbouring poses.
MOST_WITHOUT_POSE, MOST_REPEATED = 0.05, 0.5

_AXES_ADVICE = (
    "check the axes and the frame of the poses, and the pose of the LiDAR in it (KITTI: Tr in "
    "calib.txt; custom drives: sensor_in_body, up, world_up)"
)


def pose_findings(session: Session) -> list[Finding]:
    """Doubts about the poses of a session; reads no scan.

    Compares the scans' z with the world's, the motion with the horizontal plane, with the heading
    and with the stamps, and names another reading of the same numbers that agrees.
    """
    if not len(session):
        return []
    if not measurable(session.poses):
        return [_no_poses(session)]
    motion = measure_motion(session.poses)
    return [
        *(_axes(session, motion) or _heading(session, motion)),
        *_standing(session),
        *_steps(session, motion),
        *_stamps(session),
        *_without_pose(session),
    ]


def step_findings(session: Session) -> list[Finding]:
    """Doubts about the steps of a session's rigid poses, whatever the axes of its world."""
    return _steps(session, measure_motion(session.poses))


def _no_poses(session: Session) -> Finding:
    """Matrices that are no poses; readers refuse them as they read, as the digits of a file say."""
    poses = session.poses
    bad = np.flatnonzero(~measurable_rows(poses))
    return Finding(
        "poses",
        f"{len(bad)} of {len(poses)} are not rigid ({session.files[bad[0]].name}: "
        f"{rotation_problem(poses[bad[0]])})",
        "expected a rotation and metres: repair the file of the poses, or leave these out",
        unusable=True,
    )


def _axes(session: Session, motion: Motion) -> list[Finding]:
    """Tilt and plane: one finding, since they have one cause."""
    problems = axis_problems(motion)
    if not problems:
        return []
    reading = _plausible_reading(session, motion)
    advice = _AXES_ADVICE if reading is None else _as(reading)
    found = "; ".join(text for _, text in problems)
    unusable = reading is not None or any(severe for severe, _ in problems)
    return [Finding("poses", found, advice, unusable)]


def _heading(session: Session, motion: Motion) -> list[Finding]:
    """Motion whose direction in the scans' frame changes, although the path turns."""
    forward, turning = motion.forward, motion.turning
    if motion.path < LEAST_PATH or forward is None or turning is None or forward >= LEAST_FORWARD:
        return []
    found = (
        "in the scans' frame the direction of motion changes from pose to pose (constancy "
        f"{forward:.2f}; 0.99 of a vehicle that drives forwards)"
    )
    reading = _plausible_reading(session, motion, LEAST_TURNING)
    if reading is not None:
        return [Finding("poses", found, _as(reading))]
    if turning < LEAST_TURNING or forward >= ANY_DIRECTION:
        return []
    advice = "check the rotations of the poses, unless the platform drives sideways or to and fro"
    return [Finding("poses", found, advice)]


def _plausible_reading(
    session: Session, motion: Motion, least_turning: float = 0.0
) -> Reading | None:
    """The first reading of the poses with which the drive is level and goes forwards, or None."""
    for reading in READINGS:
        other = measure_motion(reading.read(session.poses))
        forwards = other.forward is None or other.forward > CLEARLY_FORWARD
        turns = (other.turning or 0.0) >= least_turning
        near = other.step < LONGEST_STEP and other.path >= min(LEAST_PATH, motion.path)
        if forwards and turns and near and not axis_problems(other):
            return reading
    return None


def _as(reading: Reading) -> str:
    return f"read as {reading.name}, they are plausible: {reading.advice}"


def _standing(session: Session) -> list[Finding]:
    """No motion, or poses held while scans go on."""
    if len(session) < STANDING_SCANS:
        return []
    positions = session.poses[:, :3, 3]
    extent = float(np.linalg.norm(np.ptp(positions, axis=0)))
    if extent < STANDING:
        return [
            Finding(
                "poses",
                f"all {len(session)} are within {extent:.3g} m",
                "expected metres of a drive: check the unit, which may be degrees or kilometres, "
                "and that poses were recorded",
            )
        ]
    held = (np.diff(session.poses, axis=0) == 0).all(axis=(1, 2))
    share = float(held.mean())
    if share > MOST_REPEATED:
        return [
            Finding(
                "poses",
                f"{share:.0%} are the same as the pose before",
                "if poses came at a lower rate than scans, interpolate them at the scans' stamps",
            )
        ]
    return []


def _steps(session: Session, motion: Motion) -> list[Finding]:
    """Steps too long for a vehicle, or for one drive."""
    if len(session) < 2:
        return []
    steps = np.linalg.norm(np.diff(session.poses[:, :3, 3], axis=0), axis=1)
    advice = "expected metres, and poses in the order of the scans: check unit, order and rows"
    fast = _too_fast(session, steps)
    found = []
    far = steps > FARTHEST_STEP
    if far.any():
        found.append(
            f"{far.sum()} of {len(steps)} steps between neighbouring poses exceed "
            f"{FARTHEST_STEP:.0f} m, up to {steps.max():.6g} m"
        )
    elif motion.step > LONGEST_STEP:
        found.append(f"neighbouring poses are {motion.step:.0f} m apart")
    elif fast.any():
        found.append(
            f"{fast.sum()} of {len(steps)} steps are faster than {FASTEST:.0f} m/s, the "
            f"longest {steps[fast].max():.0f} m"
        )
    if found and motion.step > LONGEST_STEP:
        reading = _plausible_reading(session, motion)
        advice = advice if reading is None else _as(reading)
    # A jump or two may be of one scan; most steps are of no drive in any case.
    unusable = motion.step > FARTHEST_STEP or (motion.step > LONGEST_STEP and fast.mean() > 0.5)
    if unusable:
        apart = f"{motion.step / 1000:.1f} m apart"
        advice += f"; if they are millimetres, neighbouring ones are {apart}"
    return [Finding("poses", text, advice, unusable) for text in found]


def _too_fast(session: Session, steps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the steps that no vehicle takes in the time between their stamps."""
    if session.stamps is None:
        return np.zeros(len(steps), dtype=np.bool_)
    seconds = np.diff(session.stamps / NANOSECONDS)
    return np.asarray((steps > SHORTEST_JUMP) & (steps > FASTEST * np.abs(seconds)))


def _stamps(session: Session) -> list[Finding]:
    """Equal stamps, and stamps that are no time of a drive."""
    stamps = session.stamps
    if stamps is None or len(stamps) < 2:
        return []
    repeated = int((stamps[1:] == stamps[:-1]).sum())
    found = []
    named = stamps_in_names(session.files)
    if named is not None:
        away = float(np.median(np.abs(named / NANOSECONDS - stamps / NANOSECONDS)))
        if away > MOST_AWAY:
            found.append(f"they are {away:.3g} s from those in the names of the scans, in median")
    if (stamps[1:] < stamps[:-1]).any():
        found.append("some are earlier than the one before")
    if repeated:
        found.append(f"{repeated} of {len(stamps)} are equal to the one before")
    days = (float(stamps[-1]) - float(stamps[0])) / NANOSECONDS / 86400
    if days > LONGEST_DAYS:
        found.append(f"they span {days:.0f} days, which one drive does not")
    return [
        Finding(
            "stamps",
            text,
            "expected the time of each scan, in its order: check their unit and clock",
        )
        for text in found
    ]


def _without_pose(session: Session) -> list[Finding]:
    count = session.skipped.without_pose
    total = len(session) + count
    if count <= MOST_WITHOUT_POSE * total:
        return []
    return [
        Finding(
            "poses",
            f"{count} of {total} scans have none",
            "check that scans and poses are of one drive and that no row is missing: each later "
            "scan would take the pose of another",
        )
    ]


def overlay_findings(session: Session) -> list[Finding]:
    """Doubts about the poses of a session from a few pairs of its scans; see `check_overlays`."""
    return check_overlays(session).findings
