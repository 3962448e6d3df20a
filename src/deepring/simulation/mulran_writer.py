"""MulRan's native files: gridded Ouster scans, base poses in UTM as CSV."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.io.files import write_whole
from deepring.simulation.drive import Drive
from deepring.simulation.mounting import Sensor
from deepring.simulation.sensors import Sweep
from deepring.simulation.split import UTM_ORIGIN

#: The sequences' folders, database first.
SESSIONS = ("SimCity01", "SimCity02")

_CHUNK = 20_000


def scan_path(root: Path, session: str, stamp: int) -> Path:
    """Path of the scan of ``stamp`` (microseconds); the file's name is in nanoseconds."""
    return root / session / "Ouster" / f"{stamp * 1000}.bin"


def pose_files(root: Path, session: str) -> list[Path]:
    """The files of `write_poses`."""
    return [root / session / name for name in ("ouster_front_stamp.csv", "global_pose.csv")]


def in_file_order(rays: NDArray, _sweep: Sweep) -> NDArray:
    """Values (n, ...) in the order of a scan's records, of values (C, B, ...) of all rays.

    The OS1 rotates clockwise and counts its rings from the top: point i is in ring i % 64 and
    column i // 64.
    """
    return rays[::-1, ::-1].reshape(-1, *rays.shape[2:])


def write_scan(path: Path, sweep: Sweep, _sensor: Sensor) -> None:
    """Write x, y, z, intensity (float32) of all rays; a missing return is four zeros."""
    grid = np.zeros((*sweep.reflectance.shape, 4), "<f4")
    valid = sweep.valid
    grid[valid, :3] = sweep.points[valid]
    grid[valid, 3] = sweep.reflectance[valid] * 1000
    write_whole(path, [in_file_order(grid, sweep).tobytes()])


def write_poses(root: Path, session: str, drive: Drive) -> None:
    """Write the scans' stamps (ns), and rows of stamp (ns) and 3x4 base pose in UTM."""
    stamp_file, pose_file = pose_files(root, session)
    write_whole(stamp_file, (b"%d000\n" % stamp for stamp in drive.scan_stamps.tolist()))
    write_whole(pose_file, _pose_rows(drive))


def common_files(_root: Path) -> list[Path]:
    """None: the layout has no file about both sessions."""
    return []


def write_common(_root: Path, _sensors: Sequence[Sensor]) -> None:
    """Nothing, as `common_files` says."""


def _pose_rows(drive: Drive) -> Iterator[bytes]:
    line = b"%d000" + b",%.9f,%.9f,%.9f,%.6f" * 3 + b"\n"
    for i in range(0, len(drive.pose_stamps), _CHUNK):
        stamps = drive.pose_stamps[i : i + _CHUNK]
        table = _in_utm(drive.poses(stamps))[:, :3].reshape(-1, 12)
        for stamp, row in zip(stamps.tolist(), table.tolist(), strict=True):
            yield line % (stamp, *row)


def _in_utm(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    poses = poses.copy()
    poses[:, :2, 3] += UTM_ORIGIN
    return poses
