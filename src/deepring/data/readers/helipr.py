"""HeLiPR (KAIST, SNU): four LiDARs on one car, each with its own poses.

A session is a sequence of one sensor, e.g. ``Roundabout01_Avia``, so that scans of one sensor can
be located in a map of another. All scans are x forward, y left, z up.
"""

from functools import partial
from pathlib import Path

import numpy as np

from deepring.data.poses.matching import match_scans
from deepring.data.poses.pose_tables import poses_from_quaternions, read_table, stamped_rows
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
from deepring.data.scans.records import file_problem, read_records
from deepring.data.session import Points, Session

#: Scans of the Aeva up to this stamp (ns) have no intensity, the last field of a record.
AEVA_WITHOUT_INTENSITY = 1691936557946849179


def read_helipr_scan(path: Path | str, sensor: str) -> Points:
    """Read one ``LiDAR/<sensor>/<ns>.bin``: (n, 3) float32 metres in the sensor's frame.

    Missing returns, stored as (0, 0, 0), are included. The Aeva has two record types; the file's
    stamp determines which one, or its size if its name is not a stamp. Raises BrokenScanError.
    """
    points: Points = read_records(path, _record_of(Path(path), sensor))["xyz"]
    return points


def _record_of(path: Path, sensor: str) -> np.dtype:
    late, *early = SENSORS[sensor].records
    if not early:
        return late
    if path.stem.isascii() and path.stem.isdigit() and len(path.stem) >= 19:
        return late if int(path.stem) > AEVA_WITHOUT_INTENSITY else early[0]
    return late if file_problem(path, late) is None else early[0]


def _sensor(name: str, ground_z: float, *records: str) -> BinaryScans:
    """A sensor, from the types of the unused fields that follow x, y, z in its records."""
    types = [
        np.dtype([("xyz", "<f4", (3,)), *((f"field{k}", f"<{t}") for k, t in enumerate(r.split()))])
        for r in records
    ]
    return BinaryScans(partial(read_helipr_scan, sensor=name), tuple(types), ground_z)


#: The four sensors, with little-endian records without padding, and z of the ground (metres): as
#: measured in published scans of the Avia, and for the others from the published extrinsics.
SENSORS = {
    # reflectivity, tag and line, time offset
    "Avia": _sensor("Avia", -1.67, "u1 u1 u1 u4"),
    # reflectivity, velocity, time offset, line; and, in the later scans, intensity
    "Aeva": _sensor("Aeva", -1.81, "f4 f4 i4 u1 f4", "f4 f4 i4 u1"),
    # intensity, time offset, reflectivity, ring, ambient
    "Ouster": _sensor("Ouster", -1.9, "f4 u4 u2 u2 u2"),
    # intensity, ring, time offset
    "Velodyne": _sensor("Velodyne", -1.64, "f4 u2 f4"),
}


def open_helipr(root: Path | str, name: str, pose_tolerance: float = 0.1) -> Session:
    """Open one sequence of one sensor, ``name`` = "<sequence>_<sensor>" ("Roundabout01_Ouster").

    Poses are world <- sensor, world = UTM (x east, y north, z up), of the sensor's own
    ``global_<sensor>_gt.txt``, so no extrinsic is applied; ``ground_truth`` is their (easting,
    northing). ``<sensor>_gt.txt`` begins at zero in each sequence and is not used. Poses have a
    rate of 10 Hz; for ``pose_tolerance`` (s) see `Trajectory.interpolate`. Raises LayoutError for
    a folder of another layout, and DataError if no scan is usable.
    """
    checked_tolerance(pose_tolerance)
    base = existing_root(root)
    sequence, _, sensor = name.rpartition("_")
    drives = [base / sequence, *([base] if base.name == sequence else [])]
    folder = first_folder(drive / "LiDAR" / sensor for drive in drives)
    if sensor not in SENSORS or folder is None:
        raise LayoutError(f"no scans of session {name!r}", root)
    truth = folder.parents[1] / "LiDAR_GT" / f"global_{sensor}_gt.txt"
    if not truth.is_file():
        raise LayoutError(f"no {truth.name} in {truth.parent}, the poses of session {name!r}", root)
    listing = list_scans(folder, *SENSORS[sensor].records)
    scans = match_scans(listing, read_poses(truth), pose_tolerance)
    return Session(
        name=name,
        files=scans.files,
        poses=scans.poses,
        ground_truth=scans.poses[:, :2, 3].copy(),
        stamps=scans.stamps,
        read=SENSORS[sensor].read,
        axes=("easting", "northing"),
        skipped=scans.skipped,
        ground_z=SENSORS[sensor].ground_z,
        decoding=f"helipr {sensor}",
        columns=point_columns(scans.files),
    )


def read_poses(path: Path) -> Trajectory:
    """Read ``global_<sensor>_gt.txt``: stamp (ns), x, y, z (m), qx, qy, qz, qw."""
    row = "a stamp, a whole number of nanoseconds, and x y z qx qy qz qw, separated by blanks"
    rows = read_table(path, stamped_rows(7), None, row)
    return Trajectory(rows["stamp"], poses_from_quaternions(rows["values"]), path)


def list_helipr(root: Path | str) -> list[str]:
    """Sorted names of the sessions in ``root``, a folder of sequences or one sequence."""
    base = existing_root(root)
    folders = [base] if (base / "LiDAR").is_dir() else visible_folders(base)
    return sorted(
        f"{folder.name}_{sensor}"
        for folder in folders
        for sensor in SENSORS
        if (folder / "LiDAR" / sensor).is_dir()
    )


READER = Reader(
    name="helipr",
    title="HeLiPR",
    layouts=(
        "<sequence>/LiDAR/{Avia,Aeva,Ouster,Velodyne}/<ns>.bin with "
        "<sequence>/LiDAR_GT/global_<sensor>_gt.txt",
    ),
    open=open_helipr,
    sessions=list_helipr,
    signatures=("LiDAR_GT", "Avia", "Aeva"),
    resembles=("mulran",),  # both have a folder Ouster
    scan_folders=tuple(SENSORS),
    scans={f"helipr_{name.lower()}": sensor for name, sensor in SENSORS.items()},
)
