"""The scans that `deepring localize` is given: files, folders of them, bags, and drives."""

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from numpy.typing import NDArray

from deepring.cli.notices import say_skipped
from deepring.cli.options import expect_meant
from deepring.data.readers import detect_format, ground_of, layouts_in, open_session
from deepring.data.readers.custom.drive_file import is_drive_file
from deepring.data.recording import recorded_session, scan_of_file
from deepring.data.scans.bag_files import bag_scans, is_bag
from deepring.data.scans.names import ending_of
from deepring.data.scans.point_times import TimedPoints
from deepring.data.scans.scan_files import holds_scans, read_scan, scan_files


class Scan(NamedTuple):
    """One scan to locate."""

    file: Path
    stamp: int | None
    """Nanoseconds, if the bag or the drive has stamps."""
    read: Callable[[], TimedPoints]
    ground_z: float | None
    """z of the ground in its frame, metres; None for the map's."""
    sequence: Path
    """The bag, the drive or the folder whose scans follow each other."""
    pose: NDArray | None = None
    """(4, 4) of a drive's scan."""


def named_sources(args: argparse.Namespace) -> list[Path]:
    """Files of scans, bags and drives that ``args.scans`` names; of a folder, every N-th scan.

    Raises FileError for a missing path or a folder without scans, and ConfigError for options that
    the scans leave without a meaning, or that they lack.
    """
    sources: list[Path] = []
    for path in args.scans:
        sources += [path] if is_drive(path) else scan_files([path], args.every)
    bags, drives = any(map(is_bag, sources)), any(map(is_drive, sources))
    folders = any(path.is_dir() for path in args.scans)
    expect_meant(
        args,
        topic=None if bags else "a bag",
        session=None if drives else "a dataset or a drive.yaml",
        every=None if bags or drives or folders else "a folder, a bag, a dataset or a drive.yaml",
    )
    binary = [file for file in sources if ending_of(file) == ".bin"]
    if args.format is None and len(binary) == len(sources) > 1 and binary[0].is_file():
        read_scan(binary[0])  # says once which formats there are
    return sources


def is_drive(path: Path) -> bool:
    """Whether scans have poses beside them: a drive.yaml, or a dataset of a known layout."""
    if is_drive_file(path):
        return True
    return path.is_dir() and not is_bag(path) and not holds_scans(path) and bool(layouts_in(path))


def scans_of(source: Path, args: argparse.Namespace) -> Iterator[Scan]:
    """The scans of a source: one, those of a bag, or those of a drive."""
    if is_drive(source):
        format = "custom" if is_drive_file(source) else args.format or detect_format(source)
        session = open_session(format, source, args.session)
        say_skipped(session)
        ground_z = ground_of(session, format) if args.ground_z is None else args.ground_z
        rows = range(0, len(session), args.every)
        for k, scan in zip(rows, recorded_session(session, args.every), strict=True):
            yield Scan(session.files[k], scan.stamp, scan.read, ground_z, source, session.poses[k])
    elif is_bag(source):
        for message in bag_scans(source, args.topic, args.every):
            yield Scan(source, message.stamp, message.timed, args.ground_z, source)
    else:
        read = partial(scan_of_file, source, args.format)
        yield Scan(source, None, read, args.ground_z, source.parent)
