"""Scan files on disk: list them by name and size, decode their records, explain a wrong folder."""

import os
from collections.abc import Iterable, Iterator
from fnmatch import fnmatch
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.session import Points
from deepring.errors import BrokenScanError, DeepringError

#: One point of a MulRan or KITTI scan: x, y, z in metres and an intensity, little-endian float32.
XYZI = np.dtype([("xyz", "<f4", (3,)), ("intensity", "<f4")])

#: Names that give a format away, looked for in the folder itself and a few levels below.
SIGNATURES = {
    "nclt": ("velodyne_sync", "velodyne_hits.bin", "groundtruth_*.csv"),
    "mulran": ("global_pose.csv", "Ouster"),
    "kitti": ("velodyne", "calib.txt"),
}
TITLES = {"nclt": "NCLT", "mulran": "MulRan", "kitti": "KITTI", "own": "your own data"}

_SCAN_FOLDERS = ("velodyne_sync", "Ouster", "velodyne")  # tens of thousands of files: not entered
_LARGEST_STAMP = np.iinfo(np.int64).max


class Listing(NamedTuple):
    """The scans of one folder in ascending order of the number in their names."""

    files: tuple[Path, ...]
    numbers: NDArray[np.int64]  # (n,): the number in each name times the unit asked for
    broken: tuple[str, ...]  # files left out, each with its reason


def list_scans(folder: Path, record_bytes: int, unit: int = 1) -> Listing:
    """List ``folder/<number>.bin`` without opening a file: one stat each.

    ``unit`` scales the numbers (1000 makes nanoseconds of microseconds). A file that is empty,
    is no whole number of records long, or has no number for a name goes to ``broken``.
    """
    good: list[tuple[int, Path]] = []
    broken: list[str] = []
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        # Unpacking on some systems leaves hidden "._<name>.bin" companions: not scans.
        if not entry.name.endswith(".bin") or entry.name.startswith("."):
            continue
        stem = entry.name.removesuffix(".bin")
        number = int(stem) * unit if stem.isascii() and stem.isdigit() else -1
        if not 0 <= number <= _LARGEST_STAMP:
            broken.append(f"{entry.path}: the name is no scan number or time stamp")
            continue
        problem = _stat_problem(entry, record_bytes)
        if problem:
            broken.append(f"{entry.path}: {problem}")
        else:
            good.append((number, Path(entry.path)))
    good.sort()
    numbers = np.array([number for number, _ in good], dtype=np.int64)
    return Listing(tuple(path for _, path in good), numbers, tuple(broken))


def _stat_problem(entry: os.DirEntry[str], record_bytes: int) -> str | None:
    try:
        return size_problem(entry.stat().st_size, record_bytes)
    except OSError as error:  # such as a link to nowhere
        return f"cannot be read ({error.strerror})"


def size_problem(size: int, record_bytes: int) -> str | None:
    """Say why a file of ``size`` bytes holds no whole records; None where it does."""
    if size == 0:
        return f"0 bytes, an empty file; expected records of {record_bytes} bytes each"
    if size % record_bytes:
        return f"{size} bytes; expected a multiple of {record_bytes}, the size of one point record"
    return None


def read_bytes(path: Path | str) -> bytes:
    """Read one scan file whole. Raises BrokenScanError where the file cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise BrokenScanError(
            f"{path}: cannot be read ({error.strerror}); expected a scan file"
        ) from error


def records_from(data: bytes, record: np.dtype, source: Path | str) -> NDArray:
    """View ``data`` as (n,) records. Raises BrokenScanError naming ``source`` and its size."""
    problem = size_problem(len(data), record.itemsize)
    if problem:
        raise BrokenScanError(f"{source}: {problem}. Fetch or unpack the file again")
    return np.frombuffer(data, dtype=record)


def valid_points(xyz: NDArray[np.float32], source: Path | str) -> Points:
    """Keep the finite points that are no missing return, which is written as (0, 0, 0).

    ``xyz`` is (n, 3) in metres; the result is (m, 3), float32. Raises BrokenScanError where
    no point is left.
    """
    points = np.asarray(xyz[np.isfinite(xyz).all(axis=1)], dtype=np.float32)
    points = points[points.any(axis=1)]
    if not len(points):
        raise BrokenScanError(
            f"{source}: {len(xyz)} records ({len(xyz) * XYZI.itemsize} bytes), all of them missing "
            "returns (0, 0, 0), NaN or infinite; expected at least one valid point"
        )
    return points


def existing_root(root: Path | str) -> Path:
    """Return ``root`` as an absolute path; raises DeepringError where it is no folder."""
    folder = Path(root).expanduser().absolute()
    if ".." in folder.parts:
        folder = folder.resolve()
    if not folder.is_dir():
        state = "is a file" if folder.exists() else "does not exist"
        raise DeepringError(
            f"data root {folder} {state}; expected the folder that holds the data set. "
            "Set data.root to it"
        )
    return folder


def first_folder(candidates: Iterable[Path]) -> Path | None:
    """Return the first candidate that is a folder, or None."""
    return next((path for path in candidates if path.is_dir()), None)


def first_file(candidates: Iterable[Path]) -> Path | None:
    """Return the first candidate that is a file, or None."""
    return next((path for path in candidates if path.is_file()), None)


def guess_formats(root: Path) -> tuple[str, ...]:
    """Name the formats whose typical files lie in ``root`` or at most three levels below it."""
    names = {root.name, *islice(_names_below(root, depth=3), 50_000)}
    return tuple(
        format
        for format, patterns in SIGNATURES.items()
        if any(fnmatch(name, pattern) for name in names for pattern in patterns)
    )


def _names_below(root: Path, depth: int) -> Iterator[str]:
    """Yield the names of all files and folders below ``root``, level by level."""
    level = [root]
    for _ in range(depth + 1):
        entries = [entry for folder in level for entry in _entries(folder)]
        yield from (entry.name for entry in entries)
        level = [entry for entry in entries if entry.name not in _SCAN_FOLDERS and entry.is_dir()]


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:  # a folder we may not look into tells nothing
        return []


def layout_error(problem: str, root: Path, format: str, layouts: Iterable[str]) -> DeepringError:
    """Make the error for a folder without what ``format`` needs, with the layouts it accepts."""
    others = [other for other in guess_formats(root) if other != format]
    advice = "".join(
        f" This looks like a {TITLES[other]} folder: use data={other} (--format {other})."
        for other in others
    )
    listed = "\n".join(f"  {layout}" for layout in layouts)
    advice = advice or " Point data.root at the folder that holds one of these."
    return DeepringError(
        f"{TITLES[format]}: {problem} (looked in {root}).{advice} Accepted layouts:\n{listed}"
    )


def nothing_readable(folder: Path, listing: Listing) -> DeepringError:
    """Make the error for a scan folder without one usable file."""
    if not listing.broken:
        return DeepringError(
            f"no scans: {folder} holds no .bin file; expected <number>.bin. "
            "Check that the archive was unpacked here"
        )
    return DeepringError(
        f"all {len(listing.broken)} scans of {folder} are broken (first: {listing.broken[0]}). "
        "Fetch or unpack them again"
    )
