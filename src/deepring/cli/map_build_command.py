"""`deepring map build`: a map of one or several drives, or of a point cloud."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.cli.looking import expect_lookable
from deepring.cli.map_command import look, show
from deepring.cli.notices import warn
from deepring.cli.options import expect_meant, expect_new, ground_in, network_of, open_drive
from deepring.data.clouds.autoware import METADATA, metadata_of
from deepring.data.clouds.open_cloud import is_cloud, open_cloud
from deepring.data.inspection.trajectory import expect_drive
from deepring.data.left_out import LeftOut
from deepring.data.poses.path_file import read_path
from deepring.data.poses.trajectory import Trajectory
from deepring.data.poses.tum import read_tum
from deepring.data.recording import is_recording, open_recording
from deepring.data.scans.bag_files import is_bag
from deepring.data.session import Session
from deepring.errors import ConfigError, DataError
from deepring.localization.clouds.cloud_map import map_of_cloud
from deepring.localization.clouds.virtual_scan import VirtualSensor
from deepring.localization.map import Map
from deepring.localization.map_building import SPACING, TOLERANCE_S, add_recording, add_session
from deepring.progress import Progress, progress_bar
from deepring.search.search_settings import SearchSettings

#: Options of one of the two kinds of maps alone, by their names in the parser.
_OF_CLOUDS = ("path", "height", "fov")
_OF_DRIVES = ("format", "session", "ground_z", "poses", "topic")

#: Share of the scans of a bag or a folder without a pose, beyond which the poses are no ones of it.
MOST_WITHOUT_POSE = 0.5

#: Heights of the ground in the scans of two drives that count as one, metres.
_SAME_GROUND = 0.3


class Drive(NamedTuple):
    """A drive whose places go into a map."""

    name: str
    ground_z: float
    """z of the ground under the sensor in its scans' frame, metres."""
    path: NDArray[np.float64]
    """(n, 3) positions, metres."""
    add: Callable[[Map, float, Progress, LeftOut], None]
    """Adds its places, so many metres apart, to a map."""
    doubts: tuple[str, ...]
    """What is doubtful about it."""


class Built(NamedTuple):
    """A map, and what was gone through for it."""

    map: Map
    paths: Sequence[NDArray[np.float64]]
    """Each (n, 3), positions that were driven, metres."""
    left_out: Sequence[str]
    """Why scans or places were left out."""


def build(args: argparse.Namespace) -> None:
    """Build a map of drives, or of a point cloud."""
    expect_new(args.output)
    expect_lookable(args, args.output)
    args.roots = [root.parent if root.name == METADATA else root for root in args.roots]
    clouds = [root for root in args.roots if is_cloud(root) and not _is_recording(root, args)]
    for name in _OF_DRIVES if clouds else _OF_CLOUDS:
        if getattr(args, name) is not None:
            flag = f"--{name.replace('_', '-')}"
            what, other = ("a point cloud", "a drive") if clouds else ("a drive", "a point cloud")
            root = clouds[0] if clouds else args.roots[0]
            raise ConfigError(f"{flag}: {root} is {what}, expected {other} with this option")
    if clouds and len(args.roots) > 1:
        raise ConfigError(
            f"{clouds[0]}: a point cloud beside other data, expected it alone; build a map of each "
            "and put them together with `deepring map merge`"
        )
    built = _map_of_cloud(args) if clouds else _map_of_drives(args)
    built.map.save(args.output)
    show(args, args.output, built.map, left_out=list(built.left_out))
    look(args, args.output, built.map, built.paths, built.left_out)


def _is_recording(root: Path, args: argparse.Namespace) -> bool:
    """Whether a folder of .pcd files holds scans of a drive: no metadata of tiles, but poses."""
    named = root.is_dir() and metadata_of(root) is None and is_recording(root)
    return named and args.poses is not None


def _map_of_cloud(args: argparse.Namespace) -> Built:
    sensor = VirtualSensor()
    if args.height is not None:
        sensor = replace(sensor, height=args.height)
    if args.fov is not None:
        sensor = replace(sensor, fov=tuple(args.fov))
    (root,) = args.roots
    path = None if args.path is None else read_path(args.path)
    network = network_of(args.checkpoint)
    settings = {"search": SearchSettings(args.precision), "points": args.points}
    with progress_bar("sorting points") as bar, open_cloud(root, warn, bar) as cloud:
        built = map_of_cloud(cloud, network, sensor, args.spacing, path, **settings)
    for reason in built.left_out:
        warn(f"{root}: left out {reason}")
    return Built(built.map, [] if path is None else [path], built.left_out)


def _map_of_drives(args: argparse.Namespace) -> Built:
    network = network_of(args.checkpoint)
    drives = _drives(args)
    ground_z = _common_ground(drives)
    place_map = Map(network, ground_z, search=SearchSettings(args.precision), points=args.points)
    spacing = SPACING if args.spacing is None else args.spacing
    reasons: list[str] = []
    for drive in drives:
        left_out = LeftOut()
        with progress_bar(f"{drive.name}: describing places") as bar:
            drive.add(place_map, spacing, bar, left_out)
        warn(str(left_out))
        if left_out.without_pose > MOST_WITHOUT_POSE * left_out.total:
            raise DataError(
                f"{drive.name}: {left_out.without_pose} of {left_out.total} scans have no pose "
                f"within {TOLERANCE_S:g} s before and after them, expected most to have one; check "
                "the clock of the poses, and how often they come",
                argument="poses",
            )
        if left_out.without_pose:
            warn(
                f"{drive.name}: {left_out.without_pose} of {left_out.total} scans have no "
                f"pose within {TOLERANCE_S:g} s before and after them"
            )
        reasons += left_out.reasons
    place_map.doubts = tuple(doubt for drive in drives for doubt in drive.doubts)
    names = ", ".join(drive.name for drive in drives)
    place_map.source = f"drive {names}" if len(drives) == 1 else f"drives {names}"
    return Built(place_map, [drive.path for drive in drives], reasons)


def _drives(args: argparse.Namespace) -> list[Drive]:
    """The drives that the options name, looked at before the work. All are in one world."""
    sessions = args.session or [None]
    if len(args.roots) > 1 and args.session:
        raise ConfigError(
            "--session: given with several folders, expected one folder; a drive.yaml that holds a "
            "single session names it"
        )
    recordings = [root for root in args.roots if is_recording(root)]
    expect_meant(
        args,
        topic=None if any(map(is_bag, args.roots)) else "a bag",
        session="a dataset or a drive.yaml" if len(recordings) == len(args.roots) else None,
    )
    _expect_once(args.roots, args.session or [])
    poses = dict(zip(recordings, _poses(recordings, args.poses or []), strict=True))
    drives = []
    for root in args.roots:
        if root in poses:
            trajectory, doubts = poses[root]
            drives.append(_recorded(root, trajectory, doubts, args))
            continue
        for session in sessions:
            one = argparse.Namespace(**{**vars(args), "root": root, "session": session})
            drives.append(_of_session(*open_drive(one)))
    return drives


def _expect_once(roots: Sequence[Path], sessions: Sequence[str]) -> None:
    """Raise ConfigError for a drive that is given twice: its places would be there twice."""
    for what, given in (("root", [root.resolve() for root in roots]), ("session", sessions)):
        twice = next((one for k, one in enumerate(given) if one in given[:k]), None)
        if twice is not None:
            raise ConfigError(f"{what}: {twice} is given twice, expected each drive once")


def _poses(
    recordings: Sequence[Path], files: Sequence[Path]
) -> list[tuple[Trajectory, tuple[str, ...]]]:
    """The poses of each bag and folder of scans, and what is doubtful about them."""
    if len(files) != len(recordings):
        named = ", ".join(str(root) for root in recordings) or "none"
        raise ConfigError(
            f"--poses: {len(files)} files, expected one for each bag or folder of scans, in their "
            f"order ({named}); datasets and a drive.yaml name their own poses, and `deepring "
            "loops` finds those of a bag that has none"
        )
    found = []
    for file in files:
        trajectory = read_tum(file)
        doubts = tuple(f"{file}: {finding}" for finding in expect_drive(file, trajectory))
        for doubt in doubts:
            warn(doubt)
        found.append((trajectory, doubts))
    return found


def _of_session(session: Session, ground_z: float, doubts: tuple[str, ...]) -> Drive:
    def add(to: Map, spacing: float, progress: Progress, left_out: LeftOut) -> None:
        add_session(to, session, spacing, progress, left_out)

    return Drive(session.name, ground_z, session.poses[:, :3, 3], add, doubts)


def _recorded(
    root: Path, poses: Trajectory, of_poses: tuple[str, ...], args: argparse.Namespace
) -> Drive:
    recording = open_recording(root, args.topic, args.format)
    ground_z, of_scans = ground_in(recording, args.ground_z)

    def add(to: Map, spacing: float, progress: Progress, left_out: LeftOut) -> None:
        add_recording(to, recording, poses, spacing, progress, left_out)

    return Drive(recording.name, ground_z, poses.poses[:, :3, 3], add, of_poses + of_scans)


def _common_ground(drives: Sequence[Drive]) -> float:
    first = drives[0].ground_z
    for drive in drives[1:]:
        if abs(drive.ground_z - first) > _SAME_GROUND:
            raise DataError(
                f"drives: the ground is at z = {first:g} m in the scans of {drives[0].name}, "
                f"and at {drive.ground_z:g} m in those of {drive.name}; expected sensors at "
                "one height: build a map of each and put them together with `deepring map merge`"
            )
    return first
