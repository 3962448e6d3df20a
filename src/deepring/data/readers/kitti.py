"""KITTI odometry (Karlsruhe Institute of Technology) and other data in its layout.

SemanticKITTI has the same layout, with the points' classes in ``labels/`` beside ``velodyne/``, and
many mapping tools write it.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.poses.pose_tables import poses_from_rows, read_table
from deepring.data.poses.rigid import rigid_rows, rotation_problem
from deepring.data.poses.trajectory import check_usable
from deepring.data.readers.reader import (
    BinaryScans,
    LayoutError,
    Reader,
    existing_root,
    first_file,
)
from deepring.data.scans.labels import point_columns
from deepring.data.scans.listing import Listing, list_scans
from deepring.data.scans.names import visible_folders
from deepring.data.scans.records import XYZI, read_records
from deepring.data.session import Points, Session, SkippedScans
from deepring.errors import DataError, FileError
from deepring.io.numbers_as_text import real_number
from deepring.io.text import read_text

_POSE_ROW = np.dtype([("values", np.float64, (12,))])
_TIME_ROW = np.dtype([("stamp", np.int64)])
#: The benchmark publishes no poses for these sequences.
_TEST_SEQUENCES = {str(number) for number in range(11, 22)}


def read_kitti_scan(path: Path | str) -> Points:
    """Read one ``velodyne/<frame>.bin``: (n, 3) float32 metres, x forward, y left, z up.

    Records are float32 x, y, z, reflectance, little-endian. Missing returns are included. Raises
    BrokenScanError.
    """
    points: Points = read_records(path, XYZI)["xyz"]
    return points


def read_reflectance(path: Path | str) -> NDArray[np.float32]:
    """The last number of each record, (n,) float32: 0 to 1 in KITTI. Raises BrokenScanError."""
    values: NDArray[np.float32] = read_records(path, XYZI)["intensity"]
    return values


def open_kitti(root: Path | str, sequence: str | None = None) -> Session:
    """Open one ``sequence`` ("00") below ``root``, or ``root`` itself if it is a single drive.

    The number in a scan's name is its row in ``poses.txt`` (and ``times.txt``), from 0. Rows there
    are P, the pose of cam0 in the world; with Tr (LiDAR -> cam0) of ``calib.txt`` the LiDAR's pose
    is Tr^-1 P Tr, in the frame of the first LiDAR scan. With the identity as Tr, rows are poses of
    the LiDAR. ``ground_truth`` is their (x, y); ``stamps`` are None without ``times.txt``. Scans
    without a row, or whose row is not a rigid pose, are skipped and counted. Raises LayoutError
    for a folder of another layout, and DataError if no scan is usable.
    """
    base = existing_root(root)
    drive = _find_drive(base, sequence)
    listing = list_scans(drive / "velodyne", XYZI)
    rows = _read_poses(base, drive)
    rigid = rigid_rows(rows)
    check_usable(rows, rigid, _pose_file(base, drive) or drive)
    indices = _scans_with_pose(listing, rigid, drive)
    frames = listing.numbers[indices]
    to_camera = read_calibration(drive / "calib.txt")
    poses = np.linalg.inv(to_camera) @ rows[frames] @ to_camera
    times = _read_times(drive / "times.txt", len(rows))
    return Session(
        name=drive.name,
        files=tuple(listing.files[i] for i in indices),
        poses=poses,
        ground_truth=poses[:, :2, 3].copy(),
        stamps=None if times is None else times[frames],
        read=read_kitti_scan,
        decoding="kitti",
        columns=point_columns(listing.files, read_reflectance),
        skipped=SkippedScans(
            broken=listing.broken,
            without_pose=len(listing.files) - len(indices),
            bad_poses=int(np.sum(~rigid)),
        ),
    )


def read_calibration(path: Path) -> NDArray[np.float64]:
    """Read Tr, LiDAR -> cam0, from ``calib.txt``: (4, 4) float64.

    The file has a line ``Tr:`` with 12 numbers besides KITTI's P0 to P3, or only one line of 12
    numbers. Raises FileError for any other file.
    """
    advice = "For poses that are the LiDAR's own, write: Tr: 1 0 0 0 0 1 0 0 0 0 1 0"
    text = read_text(path, f"Tr, LiDAR to camera. {advice}")
    lines = [line.partition(":") for line in text.splitlines() if line.strip()]
    texts = [numbers for name, colon, numbers in lines if colon and name.strip() == "Tr"]
    if not texts and len(lines) == 1 and not lines[0][1]:
        texts = [lines[0][0]]
    try:
        numbers = [real_number(number) for number in texts[0].split()]
        transform = poses_from_rows(np.array(numbers, dtype=np.float64).reshape(1, 12))
    except (IndexError, ValueError) as error:
        found = f"Tr is {texts[0].strip()[:200]!r}" if texts else _named(lines)
        raise FileError(
            f"{path}: {found}; expected a line 'Tr:' with 12 numbers, separated by blanks. {advice}"
        ) from error
    if not rigid_rows(transform)[0]:
        raise FileError(
            f"{path}: Tr is {texts[0].strip()[:200]}, expected a rotation and a translation, but "
            f"{rotation_problem(transform[0])}"
        )
    return np.asarray(transform[0], dtype=np.float64)


def _named(lines: list[tuple[str, str, str]]) -> str:
    """What a calibration without Tr holds, for messages."""
    names = [name.strip()[:40] for name, colon, _ in lines if colon]
    return f"has {', '.join(names[:8])}, but no Tr" if names else "has no Tr"


def list_kitti(root: Path | str) -> list[str]:
    """Sorted names of the sequences in ``root``, or its own name if it is a single drive.

    KITTI's test sequences 11 to 21 are included only if they have poses.
    """
    base = existing_root(root)
    if (base / "velodyne").is_dir():
        return [base.name]
    parents = [parent for parent in _parents(base) if parent.is_dir()]
    drives = [drive for parent in parents for drive in visible_folders(parent)]
    return sorted(
        {
            drive.name
            for drive in drives
            if (drive / "velodyne").is_dir()
            and (drive.name not in _TEST_SEQUENCES or _pose_file(base, drive))
        }
    )


def _parents(root: Path) -> tuple[Path, ...]:
    """Folders whose subfolders may be sequences."""
    return root / "sequences", root / "dataset" / "sequences", root


def _find_drive(root: Path, sequence: str | None) -> Path:
    candidates = [root] if sequence in (None, root.name) else []
    if sequence is not None:
        names = (sequence, sequence.zfill(2))  # some parsers turn "00" into "0"
        candidates += [parent / name for parent in _parents(root) for name in names]
    for drive in candidates:
        if (drive / "velodyne").is_dir():
            return drive
    problem = "no velodyne/ folder" if sequence is None else f"no scans of session {sequence!r}"
    sequences = ", ".join(list_kitti(root))
    raise LayoutError(problem + (f", expected one of {sequences}" if sequences else ""), root)


def _pose_file(root: Path, drive: Path) -> Path | None:
    """``poses.txt`` of the drive, or the official ``poses/NN.txt`` beside ``sequences``."""
    split = drive.parent.parent / "poses" / f"{drive.name}.txt"
    return first_file((drive / "poses.txt", split, root / "poses" / f"{drive.name}.txt"))


def _read_poses(root: Path, drive: Path) -> NDArray[np.float64]:
    path = _pose_file(root, drive)
    if path is None:
        problem = f"no poses.txt and no poses/NN.txt for the scans of {drive}, so no ground truth"
        raise LayoutError(problem, root)
    row = "12 numbers, separated by blanks: a 3x4 pose, row by row"
    return poses_from_rows(read_table(path, _POSE_ROW, None, row)["values"])


def _scans_with_pose(listing: Listing, rigid: NDArray[np.bool_], drive: Path) -> NDArray[np.intp]:
    """Indices of the scans whose number is a row with a pose."""
    numbers, rows = listing.numbers, len(rigid)
    in_range = numbers < rows
    if len(numbers) + len(listing.broken) == rows and not in_range.all():
        # As many scans as poses, but with other numbers: scans would silently get wrong poses.
        raise DataError(
            f"{drive}/velodyne: {rows} scans for {rows} poses, but numbered up to {numbers[-1]}; "
            f"expected names from 000000.bin to {rows - 1:06d}.bin. Rename them by their rows"
        )
    indices = np.flatnonzero(in_range & rigid[np.minimum(numbers, rows - 1)])
    if not len(indices):
        raise DataError(
            f"{drive}/velodyne: no scan with a pose: scans are numbered {numbers[0]} to "
            f"{numbers[-1]}, and the pose file has {rows} rows ({int(rigid.sum())} of them usable)."
            " The number in a scan's name is its row, from 0"
        )
    return indices


def _read_times(path: Path, rows: int) -> NDArray[np.int64] | None:
    """Stamps (n,) in nanoseconds from ``times.txt`` in seconds, or None without that file."""
    if not path.is_file():
        return None
    row = "one number, a time in seconds"
    stamps = read_table(path, _TIME_ROW, None, row, seconds=True)["stamp"]
    if len(stamps) != rows:
        raise DataError(
            f"{path}: {len(stamps)} rows for {rows} poses; expected a time in seconds for each. "
            "Fetch the file again, or remove it: time stamps are optional"
        )
    return np.asarray(stamps, dtype=np.int64)


READER = Reader(
    name="kitti",
    title="KITTI",
    layouts=(
        "velodyne/<frame>.bin with poses.txt and calib.txt beside",
        "sequences/NN/velodyne/<frame>.bin with sequences/NN/{poses.txt,calib.txt}",
        "sequences/NN/velodyne/<frame>.bin with sequences/NN/calib.txt and poses/NN.txt",
        "each also below dataset/; times.txt beside calib.txt where there are time stamps",
    ),
    open=open_kitti,
    sessions=list_kitti,
    signatures=("velodyne", "calib.txt"),
    scan_folders=("velodyne",),
    scans={"kitti": BinaryScans(read_kitti_scan, (XYZI,), ground_z=-1.73)},
)
