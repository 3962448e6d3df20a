"""MulRan (Multimodal Range Dataset, KAIST): its Ouster OS1-64 scans and sequences."""

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from deepring.checks import one_of
from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.poses.matching import match_scans
from deepring.data.poses.pose_tables import poses_from_rows, read_table, stamped_rows
from deepring.data.poses.trajectory import Trajectory, checked_tolerance
from deepring.data.readers.reader import (
    BinaryScans,
    LayoutError,
    Reader,
    existing_root,
    first_folder,
)
from deepring.data.scans.labels import point_columns
from deepring.data.scans.listing import list_scans
from deepring.data.scans.names import visible_folders
from deepring.data.scans.records import XYZI, read_records
from deepring.data.session import Points, Session

Extrinsic = Literal["tf", "inverse", "none"]

#: T_base_lidar as MulRan publishes it: metres, and roll, pitch, yaw in degrees.
T_BASE_LIDAR = pose_from(
    rotation_from_rpy(*np.radians([0.0001, 0.0003, 179.6654])), [1.7042, -0.021, 1.8047]
)


def read_mulran_scan(path: Path | str) -> Points:
    """Read one ``Ouster/<ns>.bin``: (n, 3) float32 metres in the LiDAR frame, z up.

    Records are float32 x, y, z, intensity, little-endian. Missing returns, stored as (0, 0, 0),
    are included; files may have fewer than 64 x 1024 records. Raises BrokenScanError.
    """
    points: Points = read_records(path, XYZI)["xyz"]
    return points


def read_intensity(path: Path | str) -> NDArray[np.float32]:
    """The last number of each record, (n,) float32, as the sensor gives it; BrokenScanError."""
    values: NDArray[np.float32] = read_records(path, XYZI)["intensity"]
    return values


def open_mulran(
    root: Path | str, sequence: str, pose_tolerance: float = 0.05, extrinsic: Extrinsic = "tf"
) -> Session:
    """Open one ``sequence`` ("Sejong01"); ``root`` contains sequences, or is that sequence.

    Points stay in the LiDAR frame, so poses are world <- LiDAR, world = UTM 52N (x east, y north,
    z up); ``ground_truth`` is their (easting, northing). All are float64: float32 has errors of
    decimetres at 4 million metres. ``global_pose.csv`` has poses of the base; ``extrinsic`` selects
    the pose of the LiDAR: "tf" T_world_base T_base_lidar, by MulRan's published tf; "inverse"
    T_world_base T_base_lidar^-1 and "none" T_world_base, as in other public code. For
    ``pose_tolerance`` (s) see `Trajectory.interpolate`. Raises LayoutError for a folder of another
    layout, and DataError if no scan is usable.
    """
    one_of("extrinsic", extrinsic, Extrinsic)
    checked_tolerance(pose_tolerance)
    folder, truth = _find_sequence(existing_root(root), sequence)
    scans = match_scans(list_scans(folder, XYZI), read_global_pose(truth), pose_tolerance)
    power = {"tf": 1, "inverse": -1, "none": 0}[extrinsic]
    poses: NDArray[np.float64] = scans.poses @ np.linalg.matrix_power(T_BASE_LIDAR, power)
    return Session(
        name=sequence,
        files=scans.files,
        poses=poses,
        ground_truth=poses[:, :2, 3].copy(),
        stamps=scans.stamps,
        read=read_mulran_scan,
        decoding="mulran",
        columns=point_columns(scans.files, read_intensity),
        axes=("easting", "northing"),
        skipped=scans.skipped,
    )


def read_global_pose(path: Path) -> Trajectory:
    """Read ``global_pose.csv``: stamp (ns), then T_world_base as 12 numbers, row-major 3x4."""
    row = "a stamp, a whole number of nanoseconds, and 12 numbers, comma-separated"
    rows = read_table(path, stamped_rows(12), ",", row)
    return Trajectory(rows["stamp"], poses_from_rows(rows["values"]), path)


def list_mulran(root: Path | str) -> list[str]:
    """Sorted names of the sequences with an ``Ouster`` folder in ``root``."""
    base = existing_root(root)
    if _scan_folder(base) is not None:
        return [base.name]
    return sorted(path.name for path in visible_folders(base) if _scan_folder(path) is not None)


def _scan_folder(sequence: Path) -> Path | None:
    return first_folder((sequence / "Ouster", sequence / "sensor_data" / "Ouster"))


def _find_sequence(root: Path, sequence: str) -> tuple[Path, Path]:
    folders = [root / sequence]
    if root.name == sequence:
        folders.append(root)
    for folder in folders:
        scans = _scan_folder(folder)
        if scans is None:
            continue
        if not (folder / "global_pose.csv").is_file():
            problem = f"no global_pose.csv in {folder}, the ground truth of session {sequence!r}"
            raise LayoutError(problem, root)
        return scans, folder / "global_pose.csv"
    raise LayoutError(f"no scans of session {sequence!r}", root)


READER = Reader(
    name="mulran",
    title="MulRan",
    layouts=(
        "<sequence>/Ouster/<ns>.bin with <sequence>/global_pose.csv",
        "<sequence>/sensor_data/Ouster/<ns>.bin with <sequence>/global_pose.csv",
    ),
    open=open_mulran,
    sessions=list_mulran,
    signatures=("global_pose.csv", "Ouster"),
    scan_folders=("Ouster",),
    # The LiDAR is 1.80 m above the base, which is close to the ground.
    scans={"mulran": BinaryScans(read_mulran_scan, (XYZI,), ground_z=-1.8)},
)
