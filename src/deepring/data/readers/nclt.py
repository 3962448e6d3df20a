"""NCLT (North Campus Long-Term dataset, University of Michigan): its scans and sessions.

The vehicle's body frame is x forward, y right, z down; this module returns x forward, y left, z up.
Both y and z change sign, since a change of z alone would give a left-handed frame.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import NED_TO_UP, pose_from, rotation_from_rpy
from deepring.data.poses.matching import match_scans
from deepring.data.poses.pose_tables import read_table, stamped_rows
from deepring.data.poses.trajectory import Trajectory, checked_tolerance
from deepring.data.readers.reader import (
    BinaryScans,
    LayoutError,
    Reader,
    existing_root,
    first_file,
    first_folder,
)
from deepring.data.scans.labels import point_columns
from deepring.data.scans.listing import list_scans
from deepring.data.scans.records import read_records
from deepring.data.session import Points, Session
from deepring.errors import DataError

# Coordinates are unsigned: read as int16, points beyond 63.8 m would land near -400 m.
HIT = np.dtype([("xyz", "<u2", (3,)), ("intensity", "u1"), ("laser", "u1")])
MICROSECOND = 1000  # nanoseconds: the unit of NCLT's stamps
_LARGEST_ANGLE = 6.5  # radians, more than a whole turn
_FLIP = np.diag([*np.diag(NED_TO_UP), 1.0])


def read_nclt_scan(path: Path | str) -> Points:
    """Read one ``velodyne_sync/<utime>.bin``: (n, 3) float32 metres, x forward, y left, z up.

    Records of 8 bytes, little-endian: uint16 x, y, z; uint8 intensity; uint8 laser id; metres =
    value * 0.005 - 100 (NCLT's own documentation), so all coordinates lie in -100 m..227.7 m. The
    points are in the body frame, with the Velodyne's lever arm applied. Missing returns are
    included: a record of zeros, which would be a point 173 m away, becomes NaN. Raises
    BrokenScanError.
    """
    hits = read_records(path, HIT)
    points: Points = ((hits["xyz"] * 0.005 - 100.0) @ NED_TO_UP).astype(np.float32)
    points[~hits["xyz"].any(axis=1)] = np.nan
    return points


def read_intensity(path: Path | str) -> NDArray[np.uint8]:
    """The intensity (n,) of each record, from 0 to 255. Raises BrokenScanError."""
    values: NDArray[np.uint8] = read_records(path, HIT)["intensity"]
    return values


def open_nclt(root: Path | str, date: str, pose_tolerance: float = 0.05) -> Session:
    """Open the drive of one ``date`` ("2012-02-04"); ``root`` contains drives, or is that drive.

    Poses are world <- body at the scans' stamps, world x north, y west, z up; ``ground_truth``
    is (north, east) from the file, float64. For ``pose_tolerance`` (s) see
    `Trajectory.interpolate`. Raises LayoutError for a folder of another layout, and DataError if
    no scan is usable.
    """
    checked_tolerance(pose_tolerance)
    base = existing_root(root)
    folder, truth = _find_scans(base, date), _find_ground_truth(base, date)
    listing = list_scans(folder, HIT, unit=MICROSECOND)
    scans = match_scans(listing, read_ground_truth(truth), pose_tolerance)
    return Session(
        name=date,
        files=scans.files,
        poses=_FLIP @ scans.poses @ _FLIP,
        ground_truth=scans.poses[:, :2, 3].copy(),
        stamps=scans.stamps,
        read=read_nclt_scan,
        decoding="nclt, zeros missing",
        columns=point_columns(scans.files, read_intensity),
        axes=("north", "east"),
        skipped=scans.skipped,
    )


def read_ground_truth(path: Path) -> Trajectory:
    """Read ``groundtruth_<date>.csv``: poses world <- body, both still with z down.

    Rows are utime (us), x north, y east, z down (m), roll, pitch, yaw (rad), without a header. The
    first rows may be NaN.
    """
    row = "utime, x, y, z, roll, pitch, yaw, with utime a whole number of microseconds"
    rows = read_table(path, stamped_rows(6), ",", row)
    stamps, values = rows["stamp"], rows["values"]
    largest = np.iinfo(np.int64).max // MICROSECOND
    if (stamps > largest).any() or (stamps < -largest).any():
        raise DataError(f"{path}: first column up to {stamps.max()}; expected microseconds")
    turned = np.abs(values[:, 3:]).max(axis=1) > _LARGEST_ANGLE
    if turned.mean() > 0.01:
        raise DataError(
            f"{path}: {turned.sum()} of {len(values)} rows have angles beyond a whole turn, e.g. "
            f"{values[turned][0, 3:].tolist()}; expected radians, not degrees"
        )
    # Infinite angles have no sine; they become NaN, and the row is dropped like other NaN rows.
    angles = np.where(np.isfinite(values[:, 3:]), values[:, 3:], np.nan)
    poses = pose_from(rotation_from_rpy(*angles.T), values[:, :3])
    return Trajectory(stamps * MICROSECOND, poses, path)


def list_nclt(root: Path | str) -> list[str]:
    """Sorted dates of the drives with a ``velodyne_sync`` folder in ``root``."""
    base = existing_root(root)
    if _scan_folders(base) is not None:
        return [base.name]
    dates = {path.parent.name for path in base.glob("*/velodyne_sync")} - {"velodyne_data"}
    dates |= {path.parent.parent.name for path in base.glob("*/velodyne_data/velodyne_sync")}
    dates |= {path.parent.name for path in base.glob("velodyne_data/*/velodyne_sync")}
    dates |= {path.parent.name for path in base.glob("*_vel/*/velodyne_sync")}
    return sorted(dates)


def _scan_folders(drive: Path) -> Path | None:
    return first_folder((drive / "velodyne_sync", drive / "velodyne_data" / "velodyne_sync"))


def _find_scans(root: Path, date: str) -> Path:
    drives = [root / date, root / "velodyne_data" / date, root / f"{date}_vel" / date]
    if root.name == date:
        drives.append(root)
    scans = first_folder(folder for drive in drives if (folder := _scan_folders(drive)))
    if scans is None:
        raise LayoutError(f"no scans of session {date!r}", root)
    return scans


def _find_ground_truth(root: Path, date: str) -> Path:
    drives = [root, root / date, root / "velodyne_data" / date, root / f"{date}_vel" / date]
    if root.name == date:
        drives.append(root.parent)
    folders = [folder for drive in drives for folder in (drive / "ground_truth", drive)]
    truth = first_file(folder / f"groundtruth_{date}.csv" for folder in folders)
    if truth is None:
        raise LayoutError(f"no groundtruth_{date}.csv", root)
    return truth


READER = Reader(
    name="nclt",
    title="NCLT",
    layouts=(
        "<date>/velodyne_sync/<utime>.bin",
        "<date>/velodyne_data/velodyne_sync/<utime>.bin",
        "velodyne_data/<date>/velodyne_sync/<utime>.bin",
        "<date>_vel/<date>/velodyne_sync/<utime>.bin",
        "with groundtruth_<date>.csv in ground_truth/, <date>/ground_truth/, <date>/ or beside",
    ),
    open=open_nclt,
    sessions=list_nclt,
    signatures=("velodyne_sync", "velodyne_hits.bin", "groundtruth_*.csv"),
    scan_folders=("velodyne_sync",),
    # The body's origin is close above the ground.
    scans={"nclt": BinaryScans(read_nclt_scan, (HIT,), ground_z=0.0)},
)
