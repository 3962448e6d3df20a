"""Whether the poses of a session can be those of its scans."""

import numpy as np

from deepring.data.inspection.finding import Finding
from deepring.data.inspection.motion import READINGS, Motion, Reading, measure_motion
from deepring.data.poses.pose_tables import NANOSECONDS
from deepring.data.session import Session

#: Degrees. Vehicles and robots tilt by a few degrees, a LiDAR carried by hand by up to some 30.
MOST_TILT, UNUSABLE_TILT = 35.0, 60.0
#: The path in the plane as a share of that in space: 0.98 on a slope of 20 %, 0.82 on stairs, and
#: 0 where the plane is not horizontal.
LEAST_PLANAR, UNUSABLE_PLANAR = 0.8, 0.6
#: Degrees between the plane of the motion and the horizontal.
MOST_SLOPE = 30.0
#: Constancy of the direction of motion in the scans: 0.99 on KITTI, NCLT and MulRan. Platforms that
#: drive sideways or to and fro have less, so that alone it is a doubt only where it is small.
LEAST_FORWARD, CLEARLY_FORWARD, ANY_DIRECTION = 0.8, 0.95, 0.4
#: A path turns enough to tell; see `Motion.turning`.
LEAST_TURNING = 0.2
#: Metres of path that a check of motion takes at least.
LEAST_PATH = 20.0
#: Metres per second.
FASTEST = 70.0
#: Metres. Shorter steps are not held against the speed; longer ones are of no drive, as keyframes
#: come every 1 to 50 m (poses in millimetres are 1000 times as far apart), and of no tunnel.
SHORTEST_JUMP, LONGEST_STEP, FARTHEST_STEP = 5.0, 100.0, 1000.0
#: Metres between all poses of at least so many scans, below which a drive stands still.
STANDING, STANDING_SCANS = 0.5, 10
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
    motion = measure_motion(session.poses)
    return [
        *(_axes(session, motion) or _heading(session, motion)),
        *_standing(session),
        *_steps(session, motion),
        *_stamps(session),
        *_without_pose(session),
    ]


def _axes(session: Session, motion: Motion) -> list[Finding]:
    """Tilt and plane: one finding, since they have one cause."""
    problems = _problems(motion)
    if not problems:
        return []
    reading = _plausible_reading(session, motion)
    advice = _AXES_ADVICE if reading is None else _as(reading)
    found = "; ".join(text for _, text in problems)
    unusable = reading is not None or any(severe for severe, _ in problems)
    return [Finding("poses", found, advice, unusable)]


def _problems(motion: Motion) -> list[tuple[bool, str]]:
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


def _heading(session: Session, motion: Motion) -> list[Finding]:
    """Motion in ever other directions of the scans, although the path turns."""
    forward, turning = motion.forward, motion.turning
    if motion.path < LEAST_PATH or forward is None or turning is None or forward >= LEAST_FORWARD:
        return []
    found = (
        f"the drive moves in ever other directions of its scans (constancy {forward:.2f}, 0.99 if "
        "driven forwards)"
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
        if forwards and turns and near and not _problems(other):
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
    found = []
    far = steps > FARTHEST_STEP
    if far.any():
        found.append(
            f"{far.sum()} of {len(steps)} steps between neighbouring poses exceed "
            f"{FARTHEST_STEP:.0f} m, up to {steps.max():.6g} m"
        )
    elif motion.step > LONGEST_STEP:
        found.append(f"neighbouring poses are {motion.step:.0f} m apart")
    elif session.stamps is not None:
        seconds = np.diff(session.stamps) / NANOSECONDS
        fast = (steps > SHORTEST_JUMP) & (steps > FASTEST * np.abs(seconds))
        if fast.any():
            found.append(
                f"{fast.sum()} of {len(steps)} steps are faster than {FASTEST:.0f} m/s, the "
                f"longest {steps[fast].max():.0f} m"
            )
    if found and motion.step > LONGEST_STEP:
        reading = _plausible_reading(session, motion)
        advice = advice if reading is None else _as(reading)
    return [Finding("poses", text, advice) for text in found]


def _stamps(session: Session) -> list[Finding]:
    """Equal stamps, and stamps that are no time of a drive."""
    stamps = session.stamps
    if stamps is None or len(stamps) < 2:
        return []
    repeated = int((np.diff(stamps) == 0).sum())
    found = []
    if (np.diff(stamps) < 0).any():
        found.append("some are earlier than the one before")
    if repeated:
        found.append(f"{repeated} of {len(stamps)} are equal to the one before")
    days = float(stamps[-1] - stamps[0]) / NANOSECONDS / 86400
    if days > LONGEST_DAYS:
        found.append(f"they span {days:.0f} days, which one drive does not")
    return [
        Finding("stamps", text, "expected one time for each scan, in its order: check their unit")
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


def overlay_findings(session: Session) -> list[Finding]:  # noqa: ARG001
    """Doubts about the poses of a session from a few pairs of its scans, overlaid by them."""
    return []
