"""`deepring map`: build a map of a drive, show one, or calibrate when to trust it."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.checks import fraction
from deepring.cli.console import console
from deepring.cli.options import expect_new, network_of, open_drive
from deepring.data.session import Points, Session
from deepring.data.spacing import sample_by_distance
from deepring.localization.calibration import Tolerance, calibrate, run_trials
from deepring.localization.map import Map
from deepring.progress import Progress, progress_bar
from deepring.search.correlation_index import SearchSettings


def build(args: argparse.Namespace) -> None:
    """Build a map of one session."""
    expect_new(args.output)
    network = network_of(args.checkpoint)
    session, ground_z = open_drive(args)
    with progress_bar(f"{session.name}: describing places") as bar:
        place_map = Map.build(
            session,
            network,
            args.spacing,
            ground_z,
            bar,
            search=SearchSettings(args.precision),
        )
    place_map.save(args.output)
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
    everywhere = np.ones(len(session.files), dtype=np.bool_)
    scans = sample_by_distance(session.positions, args.spacing, everywhere)
    with progress_bar(f"{session.name}: locating") as bar:
        trials = run_trials(place_map, scans_of(session, scans, bar), ground_z)
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


def scans_of(
    session: Session, scans: NDArray[np.int64], progress: Progress
) -> Iterator[tuple[Points, NDArray[np.float64]]]:
    """Points and poses of the scans with these indices."""
    for count, k in enumerate(scans.tolist(), start=1):
        yield session.points(k), session.poses[k]
        progress(count, len(scans))


def show(path: Path, place_map: Map) -> None:
    """Print what a map holds."""
    console.print(f"map          {path}, {path.stat().st_size / 1e6:.1f} MB")
    console.print(f"places       {len(place_map)}")
    if len(place_map):
        size = np.ptp(place_map.places.positions, axis=0)
        console.print(f"extent       {size[0]:.0f} m x {size[1]:.0f} m")
    settings = place_map.network.settings
    parameters = sum(p.numel() for p in place_map.network.parameters())
    console.print(f"network      {settings.label}, {parameters} parameters")
    console.print(f"descriptors  {place_map.index.settings.precision}")
    console.print(f"ground       {place_map.ground_z:g} m in the scans' frame")
    console.print(
        f"trust        fit {place_map.thresholds.fit:g}, ratio {place_map.thresholds.ratio:g}"
    )
