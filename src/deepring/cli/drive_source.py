"""The scans that `deepring loops` goes through: a drive with poses, or a recording without."""

import argparse
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.cli.options import expect_meant, ground_in, open_drive
from deepring.data.readers.custom import has_poses, record_custom
from deepring.data.readers.custom.drive_file import is_drive_file
from deepring.data.recording import (
    Recording,
    is_recording,
    open_recording,
    recorded_session,
)
from deepring.data.scans.bag_files import is_bag
from deepring.data.session import Session
from deepring.errors import ConfigError, FileError


class DriveSource(NamedTuple):
    """What the options name."""

    scans: Session | Recording
    """A drive whose poses are used, or scans whose poses the odometry finds."""
    ground_z: float
    """z of the ground in the scans' frame, metres."""
    own_poses: NDArray[np.float64] | None = None
    """(n, 4, 4) of a recording's scans, of a drive with poses that are not used."""


def open_source(args: argparse.Namespace) -> DriveSource:
    """The drive that the options of `deepring loops` name.

    Warns of what is left out and of what is doubtful. Raises DataError for an unusable drive, and
    ConfigError for options that do not fit it.
    """
    recording = _recording(args)
    if recording is None:
        session, ground_z, _ = open_drive(args)
        if not args.odometry:
            if args.every > 1:
                raise ConfigError(
                    f"every: {args.every}, expected 1 for a drive with poses: its keyframes are "
                    "as far apart as --spacing says; or add --odometry"
                )
            return DriveSource(session, ground_z)
        own = session.poses[:: args.every]
        return DriveSource(recorded_session(session, args.every), ground_z, own)
    return DriveSource(recording, ground_in(recording, args.ground_z)[0])


def _recording(args: argparse.Namespace) -> Recording | None:
    """The scans of a drive without poses; None for a drive with poses."""
    if not args.root.exists():
        raise FileError(
            f"{args.root}: no such file or folder; expected a bag, a folder of scans, a dataset "
            "or a drive.yaml"
        )
    _expect_meant(args)
    if is_recording(args.root):
        return open_recording(args.root, args.topic, args.format, args.every)
    if is_drive_file(args.root):
        if has_poses(args.root, args.session):
            return None
        return record_custom(args.root, args.session, args.every)
    if args.root.is_file():
        raise FileError(
            f"{args.root}: one file, expected a bag, a folder of scans, a dataset or a drive.yaml"
        )
    return None


def _expect_meant(args: argparse.Namespace) -> None:
    """Raise ConfigError for options that have no part in what `root` is."""
    bag = is_bag(args.root)
    expect_meant(
        args,
        topic=None if bag else "a bag",
        session="a dataset or a drive.yaml" if is_recording(args.root) else None,
        format="a folder" if bag else None,
    )
