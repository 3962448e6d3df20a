"""NCLT's native files: packed scans in the z-down body frame, ground truth as CSV."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import NED_TO_UP
from deepring.io.files import write_whole
from deepring.simulation.drive import Drive
from deepring.simulation.mounting import Sensor
from deepring.simulation.sensors import Sweep

#: The sessions' folders, database first, with dates in a year without NCLT recordings.
SESSIONS = ("2031-02-04", "2031-03-17")

_HIT = np.dtype([("xyz", "<u2", 3), ("intensity", "u1"), ("laser", "u1")])
_ROWS_WITHOUT_POSE = 3  # the real ground truth also begins with NaN
_CHUNK = 20_000


def scan_path(root: Path, session: str, stamp: int) -> Path:
    """Path of the scan of ``stamp`` (microseconds)."""
    return root / session / "velodyne_sync" / f"{stamp}.bin"


def pose_files(root: Path, session: str) -> list[Path]:
    """The files of `write_poses`."""
    return [root / "ground_truth" / f"groundtruth_{session}.csv"]


def in_file_order(rays: NDArray, sweep: Sweep) -> NDArray:
    """Values (n, ...) in the order of a scan's records, of values (C, B, ...) of all rays."""
    return rays[sweep.valid]


def write_scan(path: Path, sweep: Sweep, sensor: Sensor) -> None:
    """Write a sweep's returns, column by column, in units of 5 mm, in the body frame, z down."""
    valid = sweep.valid
    body = sweep.points[valid] @ sensor.mount[:3, :3].T + sensor.mount[:3, 3]
    hits = np.empty(len(body), _HIT)
    hits["xyz"] = np.round((body @ NED_TO_UP + 100.0) / 0.005)
    hits["intensity"] = np.round(sweep.reflectance[valid] * 255)
    hits["laser"] = np.nonzero(valid)[1]
    write_whole(path, [hits.tobytes()])


def write_poses(root: Path, session: str, drive: Drive) -> None:
    """Write utime, x north, y east, z down, roll, pitch, yaw; no header."""
    write_whole(pose_files(root, session)[0], _pose_rows(drive))


def common_files(_root: Path) -> list[Path]:
    """None: the layout has no file about both sessions."""
    return []


def write_common(_root: Path, _sensors: Sequence[Sensor]) -> None:
    """Nothing, as `common_files` says."""


def _pose_rows(drive: Drive) -> Iterator[bytes]:
    for i in range(0, len(drive.pose_stamps), _CHUNK):
        stamps = drive.pose_stamps[i : i + _CHUNK]
        table = ground_truth(drive.poses(stamps))
        if i == 0:
            table[:_ROWS_WITHOUT_POSE] = np.nan
        for stamp, row in zip(stamps.tolist(), table.tolist(), strict=True):
            yield b"%d,%.6f,%.6f,%.6f,%.8f,%.8f,%.8f\n" % (stamp, *row)


def ground_truth(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """NED position and roll, pitch, yaw (n, 6) of z-up poses (n, 4, 4)."""
    rotation = NED_TO_UP @ poses[:, :3, :3] @ NED_TO_UP
    roll = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    pitch = -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))
    yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.column_stack([poses[:, :3, 3] @ NED_TO_UP, roll, pitch, yaw])
