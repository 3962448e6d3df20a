"""Recordings of a small town of walls, and the true poses of their scans."""

from functools import partial

import numpy as np

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.recording import RecordedScan, Recording
from deepring.data.scans.point_times import TimedPoints

HEIGHT = 1.7  # metres of the sensor above the ground
START = 1_567_496_784_952_532_897


def town(seed=0, size=60.0):
    """Points (n, 3) of walls and ground in a square of this half side, metres; the ground is 0."""
    rng = np.random.default_rng(seed)
    parts = [np.column_stack([rng.uniform(-size, size, (3000, 2)), np.zeros(3000)])]
    for _ in range(90):
        along, angle = rng.uniform(-8, 8, 80), rng.uniform(0, np.pi)
        wall = rng.uniform(-size, size, 2) + along[:, None] * [np.cos(angle), np.sin(angle)]
        parts.append(np.column_stack([wall, rng.uniform(0, 7, 80)]))
    return np.concatenate(parts)


def laps(scans, radius=25.0, rounds=1.3):
    """Poses (n, 4, 4) around a circle, world <- sensor, heading along it."""
    angle = np.linspace(0, 2 * np.pi * rounds, scans)
    places = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.full(scans, HEIGHT)]
    )
    return pose_from(rotation_from_rpy(0.0, 0.0, angle + np.pi / 2), places)


def seen_from(points, pose, reach=45.0):
    """The points (m, 3) float32 within reach, in the frame of the pose."""
    near = points[np.hypot(*(points[:, :2] - pose[:2, 3]).T) < reach]
    return ((near - pose[:3, 3]) @ pose[:3, :3]).astype(np.float32)


def recording(points, poses, broken=(), name="town"):
    """The scans of these poses, 0.1 s apart; those of ``broken`` raise."""

    def scans():
        for k, pose in enumerate(poses):
            read = partial(_read, points, pose, f"{k}.npy" if k in broken else None)
            yield RecordedScan(f"{k}.npy", START + k * 10**8, read)

    return Recording(name, len(poses), scans, ground_z=-HEIGHT)


def _read(points, pose, broken):
    from deepring.errors import BrokenScanError

    if broken:
        raise BrokenScanError(f"{broken}: 0 bytes, an empty file")
    return TimedPoints(seen_from(points, pose), None)
