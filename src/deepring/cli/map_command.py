"""`deepring map`: show a map, or calibrate when to trust it."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.checks import fraction
from deepring.cli.console import console
from deepring.cli.looking import expect_lookable, show_scene, write_page
from deepring.cli.notices import warn
from deepring.cli.options import expect_new, open_drive
from deepring.data.left_out import LeftOut, usable_scans
from deepring.localization.calibration import Tolerance, calibrate, trials_of
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.place_points import VOXEL
from deepring.progress import progress_bar
from deepring.reports.map_scene import map_scene
from deepring.text import printable


def info(args: argparse.Namespace) -> None:
    """Print what a map holds, after a check of every byte."""
    expect_lookable(args)
    place_map = Map.open(args.map, check=True)
    show(args.map, place_map)
    look(args, args.map, place_map)


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
    for name, value in _facts(path, place_map):
        console.print(f"{name:<13}{value}")


def _facts(path: Path, place_map: Map) -> Iterator[tuple[str, str]]:
    """What a map holds, as names and values."""
    yield "map", f"{path}, {path.stat().st_size / 1e6:.1f} MB"
    if place_map.source:
        yield "built from", printable(place_map.source)
    yield "places", str(len(place_map))
    if len(place_map):
        size = np.ptp(place_map.places.positions, axis=0)
        yield "extent", f"{size[0]:.0f} m x {size[1]:.0f} m"
    if place_map.points is not None:
        yield "points", f"{place_map.points.count}, one per {VOXEL:g} m of each place"
    settings = place_map.network.settings
    parameters = sum(p.numel() for p in place_map.network.parameters())
    yield "network", f"{settings.label}, {parameters} parameters"
    yield "descriptors", place_map.index.settings.precision
    yield "ground", f"{place_map.ground_z:g} m in the scans' frame"
    yield "trust", f"fit {place_map.thresholds.fit:g}, ratio {place_map.thresholds.ratio:g}"


def look(
    args: argparse.Namespace,
    file: Path,
    place_map: Map,
    paths: Sequence[NDArray[np.float64]] = (),
    left_out: Sequence[str] = (),
) -> None:
    """Write the page and show the scene that the options ask for; ``paths`` (n, 3) were driven."""
    if args.page is not None:
        from deepring.reports.map_page import map_page  # draws figures, for which it needs long

        facts = list(_facts(file, place_map))
        flat = [path[:, :2] for path in paths]
        write_page(args, map_page(file.name, place_map, facts, flat, left_out))
    show_scene(args, lambda: map_scene(place_map, paths))
