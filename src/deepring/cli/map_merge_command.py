"""`deepring map merge`: two maps as one."""

import argparse
import math

from deepring.cli.console import console
from deepring.cli.map_command import show
from deepring.cli.notices import warn
from deepring.cli.options import expect_new
from deepring.core.rigid import yaw_of
from deepring.localization.map import Map
from deepring.localization.map_merge import find_frame, merged
from deepring.progress import progress_bar


def merge(args: argparse.Namespace) -> None:
    """Find the frame of one map in another, and write a map of both."""
    expect_new(args.output)
    first, second = (Map.open(path, check=True) for path in (args.first, args.second))
    with progress_bar(f"{args.second.name}: locating its places in {args.first.name}") as bar:
        frame = find_frame(first, second, bar)
    same = set(first.places.names) & set(second.places.names)
    prefix = f"{args.second.stem}/" if same else ""
    with progress_bar("describing places") as bar:
        both = merged(first, second, frame, prefix, bar)
    both.save(args.output)
    if prefix:
        warn(f"{args.second}: names that {args.first} has too; its places are now {prefix}...")
    if both.points is None and (first.points or second.points) is not None:
        warn("points: only one of the maps keeps them; the new map keeps none")
    x, y, z = map(float, frame.pose[:3, 3])
    yaw = float(yaw_of(frame.pose))
    if args.form != "json":
        console.print(
            f"found        {frame.located} of {frame.tried} places of {args.second.name}; "
            f"{frame.agreeing} agree, to {frame.error:.2f} m (median)"
        )
        turn = math.degrees(yaw)
        console.print(f"frame        x {x:.2f} m, y {y:.2f} m, z {z:.2f} m, yaw {turn:.2f} deg")
    counts = {name: getattr(frame, name) for name in ("tried", "located", "agreeing")}
    found = {**counts, "error_m": frame.error, "x": x, "y": y, "z": z, "yaw": yaw}
    show(args, args.output, both, frame=found)
