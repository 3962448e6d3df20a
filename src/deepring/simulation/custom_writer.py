"""The layout of docs/custom_data.md, for any sensor: .pcd scans, TUM poses, one drive.yaml."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.io.files import write_whole
from deepring.simulation.drive import Drive
from deepring.simulation.mounting import Sensor
from deepring.simulation.sensors import Sweep

#: The drives' names, database first.
SESSIONS = ("map", "query")

_FIELDS = ("x", "y", "z", "intensity")  # float32
_CHUNK = 20_000


def scan_path(root: Path, session: str, stamp: int) -> Path:
    """Path of the scan of ``stamp`` (microseconds)."""
    return root / session / "scans" / f"{stamp}.pcd"


def pose_files(root: Path, session: str) -> list[Path]:
    """The files of `write_poses`."""
    return [root / session / "poses.tum"]


def common_files(root: Path) -> list[Path]:
    """The file that describes both drives."""
    return [root / "drive.yaml"]


def in_file_order(rays: NDArray, sweep: Sweep) -> NDArray:
    """Values (n, ...) in the order of a scan's records, of values (C, B, ...) of all rays."""
    return rays[sweep.valid]


def write_scan(path: Path, sweep: Sweep, sensor: Sensor) -> None:
    """Write a sweep's returns, column by column, in the sensor's own frame.

    ``time`` is there if the sensor moved: seconds after the stamp.
    """
    valid = sweep.valid
    columns = [sweep.points[valid] @ sensor.stored, sweep.reflectance[valid][:, None] * 255]
    fields: tuple[str, ...] = _FIELDS
    if sweep.seconds is not None:
        columns.append(np.broadcast_to(sweep.seconds[:, None], valid.shape)[valid][:, None])
        fields += ("time",)
    rows = np.concatenate(columns, axis=1).astype("<f4")
    write_whole(path, [_header(fields, len(rows)), rows.tobytes()])


def _header(names: tuple[str, ...], count: int) -> bytes:
    many = len(names)
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE{' 4' * many}",
        f"TYPE{' F' * many}",
        f"COUNT{' 1' * many}",
        f"WIDTH {count}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        "DATA binary",
    )
    return "".join(f"{line}\n" for line in lines).encode()


def write_poses(root: Path, session: str, drive: Drive) -> None:
    """Write a row for each scan: stamp (s), x y z and qx qy qz qw of the body, z up."""
    write_whole(pose_files(root, session)[0], _pose_rows(drive))


def _pose_rows(drive: Drive) -> Iterator[bytes]:
    from scipy.spatial.transform import Rotation

    for i in range(0, len(drive.scan_stamps), _CHUNK):
        stamps = drive.scan_stamps[i : i + _CHUNK]
        poses = drive.poses(stamps)
        turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
        table = np.concatenate([poses[:, :3, 3], turns], axis=1)
        for stamp, row in zip(stamps.tolist(), table.tolist(), strict=True):
            line = b"%d.%06d %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n"
            yield line % (*divmod(stamp, 1_000_000), *row)


def write_common(root: Path, sensors: Sequence[Sensor]) -> None:
    """Write drive.yaml: where both drives' files are, and how each sensor is mounted."""
    text = "pose_format: tum\ndrives:\n"
    for name, sensor in zip(SESSIONS, sensors, strict=True):
        text += f"  {name}:\n    scans: {name}/scans\n    poses: {name}/poses.tum\n"
        text += "".join(f"    {line}\n" for line in _mounting(sensor))
    write_whole(common_files(root)[0], [text.encode()])


def _mounting(sensor: Sensor) -> list[str]:
    """The lines of a drive about its sensor."""
    mount = sensor.mount[:3].copy()
    mount[:, :3] = mount[:, :3] @ sensor.stored
    numbers = ", ".join(f"{value:.9f}" for value in (mount.ravel() + 0.0).tolist())
    return [
        f"sensor_in_body: [{numbers}]",
        f"sensor_height: {sensor.height:.6g}",
        f"up: {'-z' if sensor.upside_down else 'z'}",
    ]
