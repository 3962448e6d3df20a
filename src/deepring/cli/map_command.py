"""`deepring map`: show a map, or calibrate when to trust it."""

import argparse
from pathlib import Path

import numpy as np

from deepring.checks import fraction
from deepring.cli.console import console
from deepring.cli.notices import warn
from deepring.cli.options import expect_new, open_drive
from deepring.data.left_out import LeftOut, usable_scans
from deepring.localization.calibration import Tolerance, calibrate, trials_of
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.place_points import VOXEL
from deepring.progress import progress_bar
from deepring.text import printable


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
