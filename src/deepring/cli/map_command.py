"""`deepring map`: build a map of a drive, show one, or calibrate when to trust it."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from deepring.checks import fraction
from deepring.cli.console import console
from deepring.cli.notices import warn
from deepring.cli.options import expect_new, network_of, open_drive
from deepring.data.clouds.open_cloud import is_cloud, open_cloud
from deepring.data.left_out import LeftOut, usable_scans
from deepring.data.poses.path_file import read_path
from deepring.errors import ConfigError
from deepring.localization.calibration import Tolerance, calibrate, trials_of
from deepring.localization.cloud_map import map_of_cloud
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.place_points import VOXEL
from deepring.localization.virtual_scan import VirtualSensor
from deepring.progress import progress_bar
from deepring.search.search_settings import SearchSettings
from deepring.text import printable

#: Options of one of the two kinds of maps alone, by their names in the parser.
_OF_CLOUDS = ("path", "height", "fov")
_OF_DRIVES = ("format", "session", "ground_z")


def build(args: argparse.Namespace) -> None:
    """Build a map of one session, or of a point cloud."""
    expect_new(args.output)
    cloud = is_cloud(args.root)
    for name in _OF_DRIVES if cloud else _OF_CLOUDS:
        if getattr(args, name) is not None:
            flag = f"--{name.replace('_', '-')}"
            what, other = ("a point cloud", "a drive") if cloud else ("a drive", "a point cloud")
            raise ConfigError(f"{flag}: {args.root} is {what}, expected {other} with this option")
    (_build_of_cloud if cloud else _build_of_drive)(args)


def _build_of_cloud(args: argparse.Namespace) -> None:
    sensor = VirtualSensor()
    if args.height is not None:
        sensor = replace(sensor, height=args.height)
    if args.fov is not None:
        sensor = replace(sensor, fov=tuple(args.fov))
    path = None if args.path is None else read_path(args.path)
    network = network_of(args.checkpoint)
    with progress_bar("sorting points") as bar, open_cloud(args.root, warn, bar) as cloud:
        built = map_of_cloud(
            cloud,
            network,
            sensor,
            args.spacing,
            path,
            search=SearchSettings(args.precision),
            points=args.points,
        )
        built.map.save(args.output)
    for reason in built.left_out:
        warn(f"{args.root}: left out {reason}")
    show(args.output, built.map)


def _build_of_drive(args: argparse.Namespace) -> None:
    network = network_of(args.checkpoint)
    session, ground_z = open_drive(args)
    left_out = LeftOut()
    with progress_bar(f"{session.name}: describing places") as bar:
        place_map = Map.build(
            session,
            network,
            10.0 if args.spacing is None else args.spacing,
            ground_z,
            bar,
            left_out,
            search=SearchSettings(args.precision),
            points=args.points,
        )
    place_map.source = f"drive {session.name}"
    place_map.save(args.output)
    warn(str(left_out))
    show(args.output, place_map)


def info(args: argparse.Namespace) -> None:
    """Print what a map holds, after a check of every byte."""
    show(args.map, Map.open(args.map, check=True))


def calibrate_map(args: argparse.Namespace) -> None:
    """Write the map with thresholds that reach a precision on another drive."""
    expect_new(args.output)
    fraction("precision", args.precision)  # before the drive is located, which takes minutes
    tolerance = Tolerance(metres=args.within)
    place_map = Map.open(args.map, check=True)
    session, ground_z = open_drive(args)
    left_out = LeftOut()

    def locate(k: int) -> Location:
        return place_map.localize(session.points(k), ground_z=ground_z)

    with progress_bar(f"{session.name}: locating") as bar:
        located = usable_scans(session, args.spacing, locate, left_out, bar)
        trials = trials_of(place_map, ((location, session.poses[k]) for k, location in located))
    warn(str(left_out))
    calibration = calibrate(trials, args.precision, tolerance)
    place_map.thresholds = calibration.thresholds
    place_map.save(args.output)
    console.print(f"written      {args.output}")
    console.print(
        f"trust        fit {calibration.thresholds.fit:g}, ratio {calibration.thresholds.ratio:.3f}"
    )
    console.print(f"precision    {calibration.precision:.3f} of {calibration.trusted} trusted")
    console.print(
        f"recall       {calibration.recall:.3f}, of {calibration.scans} scans those near the map"
    )


def show(path: Path, place_map: Map) -> None:
    """Print what a map holds."""
    console.print(f"map          {path}, {path.stat().st_size / 1e6:.1f} MB")
    if place_map.source:
        console.print(f"built from   {printable(place_map.source)}")
    console.print(f"places       {len(place_map)}")
    if len(place_map):
        size = np.ptp(place_map.places.positions, axis=0)
        console.print(f"extent       {size[0]:.0f} m x {size[1]:.0f} m")
    if place_map.points is not None:
        console.print(f"points       {place_map.points.count}, one per {VOXEL:g} m of each place")
    settings = place_map.network.settings
    parameters = sum(p.numel() for p in place_map.network.parameters())
    console.print(f"network      {settings.label}, {parameters} parameters")
    console.print(f"descriptors  {place_map.index.settings.precision}")
    console.print(f"ground       {place_map.ground_z:g} m in the scans' frame")
    console.print(
        f"trust        fit {place_map.thresholds.fit:g}, ratio {place_map.thresholds.ratio:g}"
    )
