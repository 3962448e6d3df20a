"""A recording: the scans of a drive in order, whose poses are not known."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

from deepring.data.poses.stamps import stamps_in_names
from deepring.data.readers import binary_formats
from deepring.data.scans.bag_files import bag_length, bag_scans, is_bag
from deepring.data.scans.names import ending_of, files_with
from deepring.data.scans.point_times import TimedPoints
from deepring.data.scans.scan_files import SCANS, read_scan
from deepring.data.session import Session, SkippedScans
from deepring.errors import BrokenScanError, FileError


class RecordedScan(NamedTuple):
    """One scan, which is not read yet."""

    name: str
    stamp: int | None
    """Nanoseconds, or None."""
    read: Callable[[], TimedPoints]
    """Raises BrokenScanError for a scan that cannot be decoded, or without any point."""


@dataclass(frozen=True, eq=False)
class Recording:
    """The scans of one drive, in driving order. Each pass over it reads them again."""

    name: str
    count: int
    """Number of scans, as an index says it; a damaged bag gives fewer."""
    scans: Callable[[], Iterator[RecordedScan]]
    """Starts from the beginning. Raises BrokenScanError behind the last scan of a damaged bag."""
    ground_z: float | None = None
    """z of the ground under the sensor in the scans' frame, metres, if it is known."""
    skipped: SkippedScans = field(default_factory=SkippedScans)

    def __iter__(self) -> Iterator[RecordedScan]:
        return self.scans()

    def __len__(self) -> int:
        return self.count


def is_recording(path: Path) -> bool:
    """Whether a path is a bag, or a folder that itself holds scan files, unlike a dataset's."""
    return is_bag(path) or (path.is_dir() and bool(files_with(path, SCANS)))


def open_recording(
    path: Path, topic: str | None = None, binary: str | None = None, every: int = 1
) -> Recording:
    """The recording of a path of which `is_recording` is true; see the two below."""
    if is_bag(path):
        return recorded_bag(path, topic, every)
    return recorded_files(path, binary, every)


def recorded_bag(path: Path, topic: str | None = None, every: int = 1) -> Recording:
    """The point clouds of a bag; see `bag_scans`, also for the errors.

    Points carry times where the messages have a field of them.
    """

    def scans() -> Iterator[RecordedScan]:
        for scan in bag_scans(path, topic, every):
            yield RecordedScan(f"{path.name} at {scan.stamp} ns", scan.stamp, scan.timed)

    return Recording(path.stem, -(-bag_length(path, topic) // every), scans)


def recorded_files(folder: Path, binary: str | None = None, every: int = 1) -> Recording:
    """The scan files of a folder, in the order of the numbers in their names.

    Names that are times since 1970 are the stamps. ``binary`` is the format of .bin files. Raises
    FileError for a folder without scans; a .bin file without its format is a ConfigError when read.
    """
    files = files_with(folder, SCANS) if folder.is_dir() else []
    if not files:
        raise FileError(f"{folder}: no folder with scans; expected files {', '.join(SCANS)}")
    stamps = stamps_in_names(files)
    times = [None] * len(files) if stamps is None else stamps.tolist()

    bin_ground = binary_formats()[binary].ground_z if binary in binary_formats() else None
    ground_z = bin_ground if all(ending_of(file) == ".bin" for file in files) else None

    def scans() -> Iterator[RecordedScan]:
        for file, stamp in list(zip(files, times, strict=True))[::every]:
            yield RecordedScan(file.name, stamp, partial(scan_of_file, file, binary))

    return Recording(folder.name, -(-len(files) // every), scans, ground_z)


def recorded_session(session: Session, every: int = 1) -> Recording:
    """The scans of a session, as if their poses were not known."""
    stamps = [None] * len(session) if session.stamps is None else session.stamps.tolist()

    def scans() -> Iterator[RecordedScan]:
        for k in range(0, len(session), every):
            yield RecordedScan(session.files[k].name, stamps[k], partial(_scan, session, k))

    return Recording(
        session.name, -(-len(session) // every), scans, session.ground_z, session.skipped
    )


def scan_of_file(file: Path, binary: str | None) -> TimedPoints:
    """The scan of a file, whose points have no times; see `read_scan`."""
    return TimedPoints(read_scan(file, binary), None)


def _scan(session: Session, k: int) -> TimedPoints:
    return TimedPoints(session.points(k), None)


def readable_scans(recording: Recording, damage: list[str]) -> Iterator[RecordedScan]:
    """The scans of a recording; what a damaged bag says behind its last one goes to ``damage``.

    Raises BrokenScanError for a bag of which nothing can be read.
    """
    read = 0
    try:
        for scan in recording:
            yield scan
            read += 1
    except BrokenScanError as error:
        if not read:
            raise
        damage.append(str(error))
