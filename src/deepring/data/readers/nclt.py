"""NCLT (North Campus Long-Term dataset, University of Michigan): its scans, packets and sessions.

The vehicle's body frame is x forward, y right, z down; everything returned here is x forward,
y left, z up. That takes a change of sign of both y and z: of z alone would be a left-handed frame.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import NED_TO_UP, pose_from, rotation_from_rpy
from deepring.data.readers.listing import (
    existing_root,
    first_file,
    first_folder,
    layout_error,
    list_scans,
    nothing_readable,
    read_bytes,
    records_from,
)
from deepring.data.readers.trajectory import (
    Trajectory,
    checked_tolerance,
    match_scans,
    read_table,
    stamped_rows,
)
from deepring.data.session import Points, Session
from deepring.errors import BrokenScanError, DeepringError

LAYOUTS = (
    "<date>/velodyne_sync/<utime>.bin",
    "<date>/velodyne_data/velodyne_sync/<utime>.bin",
    "velodyne_data/<date>/velodyne_sync/<utime>.bin",
    "<date>_vel/<date>/velodyne_sync/<utime>.bin",
    "with groundtruth_<date>.csv in ground_truth/, <date>/ground_truth/, <date>/ or beside",
)

# Coordinates are unsigned: read as int16, points beyond 63.8 m would land near -400 m.
HIT = np.dtype([("xyz", "<u2", (3,)), ("intensity", "u1"), ("laser", "u1")])
PACKET = np.dtype([("magic", "<u2", (4,)), ("hits", "<u4"), ("utime", "<u8"), ("padding", "<u4")])
MAGIC = 44444

MICROSECOND = 1000  # nanoseconds: the unit of NCLT's stamps
_FLIP = np.diag([*np.diag(NED_TO_UP), 1.0])


class NcltPoints(NamedTuple):
    """The points of one NCLT scan or packet, in the order of the file."""

    points: Points  # (n, 3) metres, x forward, y left, z up
    intensity: NDArray[np.uint8]  # (n,)
    laser: NDArray[np.uint8]  # (n,) laser id, 0..31


def decode_nclt(data: bytes, source: Path | str = "NCLT scan") -> NcltPoints:
    """Decode NCLT's 8-byte point records: uint16 x, y, z; uint8 intensity; uint8 laser id.

    Little-endian; metres = value * 0.005 - 100 (NCLT's own documentation), so all coordinates lie
    in -100 m..227.7 m. Raises BrokenScanError, naming ``source``, for data that are empty or no
    multiple of 8 bytes long.
    """
    hits = records_from(data, HIT, source)
    points = ((hits["xyz"] * 0.005 - 100.0) @ NED_TO_UP).astype(np.float32)
    return NcltPoints(points, hits["intensity"].copy(), hits["laser"].copy())


def read_nclt_scan(path: Path | str) -> Points:
    """Read one ``velodyne_sync/<utime>.bin``: (n, 3) float32 metres, x forward, y left, z up.

    The points are in the body frame: the Velodyne's lever arm is already applied. No point is
    dropped. Raises BrokenScanError.
    """
    return decode_nclt(read_bytes(path), path).points


def read_velodyne_hits(path: Path | str) -> Iterator[tuple[int, NcltPoints]]:
    """Stream the packets of one ``velodyne_hits.bin``: (utime in microseconds, its points).

    A packet is four uint16 44444, uint32 number of hits, uint64 utime, 4 bytes padding, then the
    hits as 8-byte records. Axes change as for scans; no extrinsic and no motion compensation is
    applied. Packets without hits are passed over. Raises BrokenScanError at the first packet that
    is cut off or does not begin with 44444; those before it have been yielded by then.
    """
    try:
        with Path(path).open("rb") as stream:
            yield from _packets(stream, Path(path).stat().st_size, path)
    except OSError as error:
        raise BrokenScanError(f"{path}: cannot be read ({error.strerror})") from error


def _packets(stream: BinaryIO, size: int, path: Path | str) -> Iterator[tuple[int, NcltPoints]]:
    while (start := stream.tell()) < size:
        where = f"{path}: {size} bytes, packet at byte {start}"
        header = stream.read(PACKET.itemsize)
        if len(header) < PACKET.itemsize:
            raise BrokenScanError(f"{where}: cut off; expected a header of {PACKET.itemsize} bytes")
        packet = np.frombuffer(header, PACKET)[0]
        if (packet["magic"] != MAGIC).any():
            raise BrokenScanError(f"{where}: no packet; expected it to begin with 4 x {MAGIC}")
        length = int(packet["hits"]) * HIT.itemsize
        if length > size - stream.tell():
            raise BrokenScanError(f"{where}: cut off; expected {packet['hits']} hits in it")
        if length:
            yield int(packet["utime"]), decode_nclt(stream.read(length), where)


def open_nclt(root: Path | str, date: str, pose_tolerance: float = 0.05) -> Session:
    """Open the drive of one ``date`` ("2012-02-04"); ``root`` may hold many, or be that drive.

    Poses are world <- body at the scans' stamps, world x north, y west, z up; ``ground_truth``
    is (north, east) as the file has it, float64. ``pose_tolerance`` (s): see
    ``Trajectory.interpolate``. Raises DeepringError for a folder of another layout, or where no
    scan can be used.
    """
    checked_tolerance(pose_tolerance)
    base = existing_root(root)
    folder, truth = _find_scans(base, date), _find_ground_truth(base, date)
    listing = list_scans(folder, HIT.itemsize, unit=MICROSECOND)
    if not listing.files:
        raise nothing_readable(folder, listing)
    scans = match_scans(listing, read_ground_truth(truth), pose_tolerance)
    return Session(
        name=date,
        files=scans.files,
        poses=_FLIP @ scans.poses @ _FLIP,
        ground_truth=scans.poses[:, :2, 3].copy(),
        stamps=scans.stamps,
        read=read_nclt_scan,
        axes=("north", "east"),
        skipped=scans.skipped,
    )


def read_ground_truth(path: Path) -> Trajectory:
    """Read ``groundtruth_<date>.csv``: poses world <- body, both still with z down.

    Rows are utime (us), x north, y east, z down (m), roll, pitch, yaw (rad), and there is no
    header: taking the first row for one would lose a pose. NaN rows occur at the start.
    """
    expected = "utime, x, y, z, roll, pitch, yaw, with utime a whole number of microseconds"
    rows = read_table(path, stamped_rows(6), ",", expected)
    stamps, values = rows["stamp"], rows["values"]
    if (np.abs(stamps) > np.iinfo(np.int64).max // MICROSECOND).any():
        raise DeepringError(f"{path}: first column up to {stamps.max()}; expected microseconds")
    # Infinite angles have no sine: they become NaN here, and the row is dropped with the others.
    angles = np.where(np.isfinite(values[:, 3:]), values[:, 3:], np.nan)
    poses = pose_from(rotation_from_rpy(*angles.T), values[:, :3])
    return Trajectory(stamps * MICROSECOND, poses, path)


def list_nclt(root: Path | str) -> list[str]:
    """Dates of the drives with a ``velodyne_sync`` folder in ``root``, sorted."""
    base = existing_root(root)
    if _scan_folders(base) is not None:
        return [base.name]
    found = {path.parent.name for path in base.glob("*/velodyne_sync")} - {"velodyne_data"}
    found |= {path.parent.parent.name for path in base.glob("*/velodyne_data/velodyne_sync")}
    found |= {path.parent.name for path in base.glob("velodyne_data/*/velodyne_sync")}
    found |= {path.parent.name for path in base.glob("*_vel/*/velodyne_sync")}
    return sorted(found)


def _scan_folders(drive: Path) -> Path | None:
    return first_folder((drive / "velodyne_sync", drive / "velodyne_data" / "velodyne_sync"))


def _find_scans(root: Path, date: str) -> Path:
    drives = [root / date, root / "velodyne_data" / date, root / f"{date}_vel" / date]
    if root.name == date:
        drives.append(root)
    found = first_folder(folder for drive in drives if (folder := _scan_folders(drive)))
    if found is None:
        raise layout_error(f"no scans of session {date!r}", root, "nclt", LAYOUTS)
    return found


def _find_ground_truth(root: Path, date: str) -> Path:
    drives = [root, root / date, root / "velodyne_data" / date, root / f"{date}_vel" / date]
    if root.name == date:
        drives.append(root.parent)
    folders = [folder for drive in drives for folder in (drive / "ground_truth", drive)]
    found = first_file(folder / f"groundtruth_{date}.csv" for folder in folders)
    if found is None:
        raise layout_error(f"no groundtruth_{date}.csv for it", root, "nclt", LAYOUTS)
    return found
