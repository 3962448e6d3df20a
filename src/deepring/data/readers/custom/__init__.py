"""Custom datasets: scans and poses in a folder, described by a YAML file."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from
from deepring.data.poses.pose_tables import (
    poses_from_quaternions,
    poses_from_rows,
    read_table,
    stamped_rows,
)
from deepring.data.poses.rigid import rigid_rows, rotation_problem
from deepring.data.poses.stamps import seconds_text, stamps_in_names
from deepring.data.readers import binary_formats
from deepring.data.readers.custom.custom_scans import UP, CustomScans
from deepring.data.readers.custom.drive_file import (
    ENDINGS,
    SENSOR_WORLD,
    DriveDescription,
    is_drive_file,
    read_drives,
)
from deepring.data.readers.reader import LayoutError, Reader
from deepring.data.recording import RecordedScan, Recording
from deepring.data.scans.labels import point_columns
from deepring.data.scans.names import ending_of, files_with
from deepring.data.scans.point_times import TimedPoints
from deepring.data.scans.records import file_problem
from deepring.data.scans.returns import scan_from
from deepring.data.scans.scan_files import SCANS
from deepring.data.session import Session, SkippedScans
from deepring.errors import ConfigError, DataError, FileError

_KITTI_ROW = np.dtype([("values", np.float64, (12,))])
_BYTE = np.dtype("u1")


def open_custom(root: Path | str, name: str | None = None) -> Session:
    """Open drive ``name`` of the YAML file ``root``; optional if there is only one.

    Scans are z up in the sensor's frame; poses are world <- that frame, world z up:
    T_world_body · T_body_sensor, both rotated by the up axes in the file (see `DriveDescription`).
    ``ground_truth`` is their (x, y), ``stamps`` are those of TUM rows or None, ``ground_z`` is
    minus the sensor's height. Files with an impossible size are skipped and counted. Raises
    FileError for a missing folder or file, ConfigError for an invalid description, e.g. with scans
    tilted by more than 60° in the world, and DataError for different numbers of scans and poses,
    or a pose that is not rigid.
    """
    drive = _drive(_drives(root), root, name)
    poses_file = _poses_file(drive)
    files = _scans(drive)
    rows, stamps = _pose_rows(drive, poses_file)
    if len(rows) != len(files):
        raise DataError(
            f"{drive.file}: {len(files)} scans in {drive.scans}, but {len(rows)} poses in "
            f"{poses_file}; expected one pose per scan, in the order of the scans' names. Remove "
            "scans without a pose, and poses without a scan"
        )
    usable, reasons = _usable(drive, files)
    poses = z_up_poses(rows[usable], drive)
    _expect_upright(poses, drive)
    reader = _reader(drive)
    return Session(
        name=drive.name,
        files=tuple(files[k] for k in usable),
        poses=poses,
        ground_truth=poses[:, :2, 3].copy(),
        stamps=None if stamps is None else stamps[usable],
        read=reader,
        skipped=SkippedScans(broken=reasons),
        ground_z=-drive.sensor_height,
        decoding=reader.decoding,
        columns=point_columns(files, labels=reader.labels),
    )


def record_custom(root: Path | str, name: str | None = None, every: int = 1) -> Recording:
    """The scans of drive ``name`` of the YAML file ``root``, whose poses are not known.

    Times since 1970 in the names of the scans are their stamps. Raises as `open_custom` does.
    """
    drive = _drive(_drives(root), root, name)
    files = _scans(drive)
    usable, reasons = _usable(drive, files)
    read, stamps = _reader(drive), stamps_in_names(files)

    def scans() -> Iterator[RecordedScan]:
        for k in usable[::every]:
            stamp = None if stamps is None else int(stamps[k])
            yield RecordedScan(files[k].name, stamp, partial(_timed, read, files[k]))

    skipped = SkippedScans(broken=reasons)
    return Recording(drive.name, -(-len(usable) // every), scans, -drive.sensor_height, skipped)


def has_poses(root: Path | str, name: str | None = None) -> bool:
    """Whether the file gives poses for drive ``name``; raises as `open_custom` does."""
    return _drive(_drives(root), root, name).poses is not None


def list_custom(root: Path | str) -> list[str]:
    """Names of the drives in the YAML file ``root``, in its order."""
    return list(_drives(root))


def z_up_poses(rows: NDArray[np.float64], drive: DriveDescription) -> NDArray[np.float64]:
    """Poses (n, 4, 4), z-up world <- z-up sensor, from ``rows``, the file's world <- body."""
    to_body = np.eye(4) if drive.sensor_in_body is None else drive.sensor_in_body
    sensor = pose_from(UP[drive.up], np.zeros(3))
    if drive.world_up == SENSOR_WORLD:
        world = sensor @ np.linalg.inv(to_body)
    else:
        world = pose_from(UP[drive.world_up], np.zeros(3))
    poses: NDArray[np.float64] = world @ rows @ to_body @ sensor.T
    return poses


def _drives(root: Path | str) -> dict[str, DriveDescription]:
    if not is_drive_file(root):
        raise LayoutError("no .yaml or .yml file", root)
    return read_drives(root)


def _drive(
    drives: dict[str, DriveDescription], root: Path | str, name: str | None
) -> DriveDescription:
    if name is None and len(drives) == 1:
        return next(iter(drives.values()))
    if name not in drives:
        problem = "several drives" if name is None else f"no drive {name!r}"
        raise DataError(f"{root}: {problem}, expected the name of one of {', '.join(drives)}")
    return drives[name]


def _scans(drive: DriveDescription) -> list[Path]:
    """The drive's scan files in the order of their names."""
    if not _is(drive.scans, "dir"):
        raise FileError(
            f"{drive.file}: scans: {_short(drive.scans)} is not a folder; expected that of the "
            "scans, relative to this file's folder"
        )
    files = files_with(drive.scans, SCANS)
    if not files:
        raise FileError(
            f"{drive.file}: scans: {drive.scans} is a folder without scans; expected files ending "
            f"in {', '.join(SCANS)}"
        )
    if drive.format is None and any(ending_of(file) == ".bin" for file in files):
        raise ConfigError(
            f"{drive.file}: format: missing, expected that of the .bin files in {drive.scans}: "
            f"add one of {', '.join(binary_formats())}"
        )
    return files


def _usable(drive: DriveDescription, files: list[Path]) -> tuple[NDArray[np.intp], tuple[str, ...]]:
    """Numbers of the files whose sizes are possible, and why the others are left out."""
    problems = [_problem(file, drive.format) for file in files]
    usable = np.array([k for k, problem in enumerate(problems) if problem is None], dtype=np.intp)
    reasons = tuple(problem for problem in problems if problem is not None)
    if not len(usable):
        raise DataError(f"all {len(files)} scans of {drive.scans} are broken: {reasons[0]}")
    return usable, reasons


def _reader(drive: DriveDescription) -> CustomScans:
    return CustomScans(
        drive.format, drive.up, drive.sensor_height, drive.z_band, drive.azimuth, drive.range
    )


def _timed(read: CustomScans, file: Path) -> TimedPoints:
    return TimedPoints(scan_from(read(file), file).points, None)


def _problem(file: Path, format: str | None) -> str | None:
    """The reason why a file cannot be a scan, by its size, or None."""
    records: tuple[np.dtype, ...] = (_BYTE,)
    if ending_of(file) == ".bin" and format is not None:
        records = binary_formats()[format].records
    problem = file_problem(file, *records)
    return None if problem is None else f"{file}: {problem}"


def _poses_file(drive: DriveDescription) -> Path:
    """The file of the drive's poses, which only some commands can do without."""
    if drive.poses is None:
        raise ConfigError(
            f"{drive.file}: poses: missing, expected the file of the poses, as text: add it. Only "
            "deepring loops finds poses from the scans alone"
        )
    return drive.poses


def _pose_rows(
    drive: DriveDescription, poses: Path
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Poses (n, 4, 4) from the file, and their stamps (n,) in nanoseconds or None."""
    if not _is(poses, "file"):
        raise FileError(
            f"{drive.file}: poses: {_short(poses)} is not a file; expected the file of the "
            "poses, relative to this file's folder"
        )
    if drive.pose_format == "tum":
        return _tum(poses)
    row = "12 numbers, separated by blanks: a 3x4 pose, row by row (pose_format: kitti)"
    rows = poses_from_rows(read_table(poses, _KITTI_ROW, None, row)["values"])
    return _rigid(rows, poses), None


def _tum(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    row = "stamp x y z qx qy qz qw, separated by blanks (pose_format: tum)"
    rows = read_table(path, stamped_rows(7), None, row, seconds=True)
    stamps, values = np.asarray(rows["stamp"], dtype=np.int64), rows["values"]
    # Rows out of order would silently go to the wrong scans.
    falling = np.flatnonzero(stamps[1:] < stamps[:-1])
    if len(falling):
        k = int(falling[0])
        raise DataError(
            f"{path}: stamp {seconds_text(stamps[k + 1])} follows {seconds_text(stamps[k])}; "
            "expected seconds in ascending order, that of the scans' names"
        )
    return _rigid(poses_from_quaternions(values), path), stamps


def _expect_upright(poses: NDArray[np.float64], drive: DriveDescription) -> None:
    """Raise ConfigError for a wrong up axis, which would silently give images from the side."""
    tilt = math.degrees(math.acos(np.clip(np.median(poses[:, 2, 2]), -1, 1)))
    if tilt > 60:
        raise ConfigError(
            f"{drive.file}: up: {drive.up}, world_up: {drive.world_up}; with these, scans are "
            f"tilted by {tilt:.0f}° in half of the poses, expected at most 60°. Set up to the axis "
            "of the scans that points up, and world_up to that of the poses' world; where the "
            "poses are those of the vehicle, leave up out and give sensor_in_body"
            + ("; quaternions are read as qx qy qz qw" if drive.pose_format == "tum" else "")
        )


def _rigid(poses: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    bad = np.flatnonzero(~rigid_rows(poses))
    if len(bad):
        raise DataError(
            f"{path}: pose {bad[0] + 1} of {len(poses)} is not rigid ({len(bad)} are not): "
            f"{rotation_problem(poses[bad[0]])}. Check pose_format, or remove the pose and its scan"
        )
    return poses


def _short(path: Path) -> str:
    """A path as text; of a very long one the beginning."""
    text = str(path)
    return text if len(text) <= 300 else f"{text[:300]}..."


def _is(path: Path, kind: str) -> bool:
    try:
        return path.is_dir() if kind == "dir" else path.is_file()
    except (OSError, ValueError):  # an invalid or too long name
        return False


READER = Reader(
    name="custom",
    title="custom drives",
    layouts=("<name>.yaml, which describes scans and poses (`deepring schema drive_file`)",),
    open=open_custom,
    sessions=list_custom,
    file_endings=ENDINGS,
)
