"""MulRan (Multimodal Range Dataset, KAIST): its Ouster OS1-64 scans and sequences."""

from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.readers.listing import (
    XYZI,
    existing_root,
    first_folder,
    layout_error,
    list_scans,
    nothing_readable,
    read_bytes,
    records_from,
    valid_points,
)
from deepring.data.readers.trajectory import (
    Trajectory,
    checked_tolerance,
    match_scans,
    poses_from_rows,
    read_table,
    stamped_rows,
)
from deepring.data.session import Points, Session
from deepring.errors import DeepringError

LAYOUTS = (
    "<sequence>/Ouster/<ns>.bin with <sequence>/global_pose.csv",
    "<sequence>/sensor_data/Ouster/<ns>.bin with <sequence>/global_pose.csv",
)

Extrinsic = Literal["tf", "inverse", "none"]

#: T_base_lidar as MulRan publishes it: metres, and roll, pitch, yaw in degrees.
T_BASE_LIDAR = pose_from(
    rotation_from_rpy(*np.radians([0.0001, 0.0003, 179.6654])), [1.7042, -0.021, 1.8047]
)

RINGS = 64


class MulranPoints(NamedTuple):
    """The records of one MulRan scan in the order of the file, missing returns included."""

    points: Points  # (n, 3) metres in the LiDAR frame; (0, 0, 0) where nothing came back
    intensity: NDArray[np.float32]  # (n,)
    ring: NDArray[np.uint8]  # (n,) 0..63
    column: NDArray[np.uint32]  # (n,) 0..1023, along the sensor's turn


def decode_mulran(data: bytes, source: Path | str = "MulRan scan") -> MulranPoints:
    """Decode MulRan's 16-byte records: float32 x, y, z, intensity, little-endian.

    A full scan has 64 x 1024 records, a column of 64 rings after the other: ring = i % 64 and
    column = i // 64. Short scans decode as far as they go. Raises BrokenScanError, naming
    ``source``, for data that are empty or no multiple of 16 bytes long.
    """
    records = records_from(data, XYZI, source)
    index = np.arange(len(records))
    return MulranPoints(
        points=records["xyz"].astype(np.float32),
        intensity=records["intensity"].astype(np.float32),
        ring=(index % RINGS).astype(np.uint8),
        column=(index // RINGS).astype(np.uint32),
    )


def read_mulran_scan(path: Path | str) -> Points:
    """Read one ``Ouster/<ns>.bin``: (m, 3) float32 metres in the LiDAR frame, z up.

    Missing returns, written as (0, 0, 0), and points with NaN or infinity are dropped; a file
    shorter than 65 536 points is read as far as it goes. Raises BrokenScanError.
    """
    return valid_points(decode_mulran(read_bytes(path), path).points, path)


def open_mulran(
    root: Path | str, sequence: str, pose_tolerance: float = 0.05, extrinsic: Extrinsic = "tf"
) -> Session:
    """Open one ``sequence`` ("Sejong01"); ``root`` may hold many, or be that sequence.

    Points stay in the LiDAR frame, so poses are world <- LiDAR, world = UTM 52N (x east, y north,
    z up); ``ground_truth`` is their (easting, northing). All float64: float32 is off by decimetres
    at 4 million metres. ``global_pose.csv`` has the base frame; ``extrinsic`` says how it becomes
    the LiDAR's: "tf" T_world_base T_base_lidar, as MulRan's published tf states; "inverse"
    T_world_base T_base_lidar^-1 and "none" T_world_base, as other public code has it.
    ``pose_tolerance`` (s): see ``Trajectory.interpolate``. Raises DeepringError for a folder of
    another layout, or where no scan can be used.
    """
    base_to_lidar = _extrinsic(extrinsic)
    checked_tolerance(pose_tolerance)
    folder, truth = _find_sequence(existing_root(root), sequence)
    listing = list_scans(folder, XYZI.itemsize)
    if not listing.files:
        raise nothing_readable(folder, listing)
    scans = match_scans(listing, read_global_pose(truth), pose_tolerance)
    poses = scans.poses @ base_to_lidar
    return Session(
        name=sequence,
        files=scans.files,
        poses=poses,
        ground_truth=poses[:, :2, 3].copy(),
        stamps=scans.stamps,
        read=read_mulran_scan,
        axes=("easting", "northing"),
        skipped=scans.skipped,
    )


def read_global_pose(path: Path) -> Trajectory:
    """Read ``global_pose.csv``: stamp (ns), then T_world_base as 12 numbers, row-major 3x4."""
    expected = "a stamp, a whole number of nanoseconds, and 12 numbers, comma-separated"
    rows = read_table(path, stamped_rows(12), ",", expected)
    return Trajectory(rows["stamp"], poses_from_rows(rows["values"]), path)


def list_mulran(root: Path | str) -> list[str]:
    """Names of the sequences with an ``Ouster`` folder in ``root``, sorted."""
    base = existing_root(root)
    if _scan_folder(base) is not None:
        return [base.name]
    return sorted(path.name for path in base.iterdir() if _scan_folder(path) is not None)


def _extrinsic(choice: str) -> NDArray[np.float64]:
    if choice not in get_args(Extrinsic):
        raise DeepringError(
            f'extrinsic = {choice!r}; expected one of {", ".join(get_args(Extrinsic))} ("tf" is '
            "what MulRan publishes)"
        )
    power = {"tf": 1, "inverse": -1, "none": 0}[choice]
    return np.asarray(np.linalg.matrix_power(T_BASE_LIDAR, power), dtype=np.float64)


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
            raise layout_error(problem, root, "mulran", LAYOUTS)
        return scans, folder / "global_pose.csv"
    raise layout_error(f"no scans of session {sequence!r}", root, "mulran", LAYOUTS)
