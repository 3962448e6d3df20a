"""`deepring map`: show a map, or calibrate when to trust it."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.checks import fraction
from deepring.cli.console import console
from deepring.cli.json_output import print_as
from deepring.cli.looking import expect_lookable, show_scene, write_page
from deepring.cli.map_content import map_content, map_facts
from deepring.cli.notices import warn
from deepring.cli.options import expect_new, open_drive
from deepring.data.left_out import LeftOut, usable_scans
from deepring.localization.calibration import Tolerance, calibrate, trials_of
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.progress import progress_bar
from deepring.reports.map_scene import map_scene


def info(args: argparse.Namespace) -> None:
    """Print what a map holds, after a check of every byte."""
    expect_lookable(args)
    place_map = Map.open(args.map, check=True)
    show(args, args.map, place_map)
    look(args, args.map, place_map)


def calibrate_map(args: argparse.Namespace) -> None:
    """Write the map with thresholds that reach a precision on another drive."""
    expect_new(args.output)
    fraction("precision", args.precision)  # before the drive is located, which takes minutes
    tolerance = Tolerance(metres=args.within)
    place_map = Map.open(args.map, check=True)
    session, ground_z, _ = open_drive(args)
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
    fit, ratio = calibration.thresholds.fit, calibration.thresholds.ratio
    lines = (
        f"written      {args.output}",
        f"trust        fit {fit:g}, ratio {ratio:.3f}",
        f"precision    {calibration.precision:.3f} of {calibration.trusted} trusted",
        f"recall       {calibration.recall:.3f}, of {calibration.scans} scans those near the map",
    )
    found = {
        "precision": calibration.precision,
        "recall": calibration.recall,
        "trusted": calibration.trusted,
        "scans": calibration.scans,
    }
    print_as(
        args,
        "map",
        lambda: {**map_content(args.output, place_map), "calibration": found},
        lambda: console.print("\n".join(lines)),
    )


def show(args: argparse.Namespace, path: Path, place_map: Map, **further: Any) -> None:
    """Print what a map holds; ``further`` keys stand in JSON alone."""

    def text() -> None:
        for name, value in map_facts(path, place_map):
            console.print(f"{name:<13}{value}")

    print_as(args, "map", lambda: {**map_content(path, place_map), **further}, text)


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

        facts = list(map_facts(file, place_map))
        flat = [path[:, :2] for path in paths]
        write_page(args, map_page(file.name, place_map, facts, flat, left_out))
    show_scene(args, lambda: map_scene(place_map, paths))
