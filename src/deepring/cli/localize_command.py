"""`deepring localize`: positions of scans in a map, as a table, JSON or CSV."""

import argparse
import csv
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from deepring.cli.console import console
from deepring.cli.joined_scans import JoinedScans
from deepring.cli.json_output import print_json
from deepring.cli.located_scans import named_sources, scans_of
from deepring.cli.looking import expect_lookable
from deepring.cli.mistakes import MISTAKE, error_message
from deepring.cli.notices import warn
from deepring.cli.refined_rows import CSV, TABLE, csv_values, json_values, table_cells, table_notes
from deepring.cli.shown_scans import ShownScans
from deepring.data.inspection.scans import expect_coordinates
from deepring.data.scans.bag_files import is_bag
from deepring.data.scans.names import ending_of
from deepring.data.scans.scan_files import SCANS
from deepring.errors import ConfigError, DeepringError
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.registration.refinement import small_gicp
from deepring.progress import progress_bar
from deepring.text import printable

#: What the table says about trust; doubts not listed here say that one cannot tell.
_TRUST = {None: "yes", "fit": "no", "ratio": "no"}

#: A row: file and stamp (ns) of a scan, if it has one, its location, and with --refine as
#: ``refined`` its `RefinedPose`.
Row = dict[str, Any]


def localize_command(args: argparse.Namespace) -> None:
    """Print where each scan was taken.

    Exits with 1 if some scans cannot be located, and with 2 if none can.
    """
    expect_lookable(args)
    sources = named_sources(args)
    joining = JoinedScans(args.accumulate)
    place_map = Map.open(args.map, check=not args.unchecked)
    if args.refine:
        _expect_refinable(place_map, args.map)
    for doubt in place_map.doubts:
        warn(f"{args.map}: built from doubtful data: {doubt}")
    failures: list[str] = []
    shown = ShownScans(args, place_map)
    with progress_bar("locating") as bar:
        rows = list(locate(place_map, sources, args, joining, failures, bar, shown))
    warn(joining.warning())
    if args.form == "json":
        print_json("locations", _content(args.map, rows, failures))
    elif rows or not failures:
        _PRINT[args.form](rows)
    for message in failures:
        print(f"error: {message}", file=sys.stderr)
    if rows:
        shown.show(failures)
    if failures:
        sys.exit(1 if rows else MISTAKE)


def locate(
    place_map: Map,
    sources: Sequence[Path],
    args: argparse.Namespace,
    joining: JoinedScans,
    failures: list[str],
    progress: Callable[[int, int], None],
    shown: ShownScans,
) -> Iterator[Row]:
    """One row per scan; the messages about scans that cannot be located go to ``failures``.

    ``shown`` receives each located scan. ``args`` has ``format``, ``topic``, ``every``,
    ``session``, ``ground_z``, ``refine`` and ``flags``.
    """
    count = 0
    for source in sources:
        scans = scans_of(source, args)
        while True:
            name, stamp = source, None
            try:
                name, stamp, read, ground_z, sequence, pose = next(scans)
                scan = read()
                expect_coordinates(scan.points)
                points = joining.points(sequence, scan, stamp)
                seen = place_map.observe([points], ground_z)
                location = place_map.localize_observation(seen)
                row = {"scan": str(name), "stamp": stamp, **asdict(location)}
                if args.refine:
                    row["refined"] = place_map.refine(points, location, ground_z)
                shown.add(
                    name.name, stamp, row.get("refined"), location, seen, points, ground_z, pose
                )
                yield row
            except StopIteration:
                break
            except DeepringError as error:
                failures.append(_with_scan(name, stamp, error_message(error, args.flags)))
            count += 1
            # The number of scans in a bag is not known in advance.
            progress(count, max(count, len(sources)))


def _expect_refinable(place_map: Map, file: Path) -> None:
    """Raise ConfigError for a map without points, and without the library that registers them."""
    if place_map.points is None:
        raise ConfigError(
            f"--refine: {file} holds no points of its places, expected them; build it again with "
            "deepring map build --points"
        )
    small_gicp()


def _with_scan(file: Path, stamp: int | None, message: str) -> str:
    """The message, which prints as it is, with the scan's file and stamp."""
    name = printable(str(file))
    if name in message:
        return message
    return f"{name}: {message}" if stamp is None else f"{name} at {stamp} ns: {message}"


def print_table(rows: Sequence[Row]) -> None:
    """Print a table."""
    refined = any("refined" in row for row in rows)
    found = TABLE if refined else ("x m", "y m", "yaw °", "fit", "ratio")
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("scan", *found, "trusted", "found by"):
        if name in ("scan", "found by"):  # names give way on narrow terminals, numbers do not
            table.add_column(name, overflow="fold")
        else:
            table.add_column(Text(name), justify="right", no_wrap=name != "trusted")
    scans, places = _short([_scan_name(row) for row in rows]), _short([row["name"] for row in rows])
    for row, scan, place in zip(rows, scans, places, strict=True):
        table.add_row(
            printable(scan),
            *map(Text, table_cells(row["refined"]) if refined else _location_cells(row)),
            _trust(row),
            printable(place),
        )
    endless = console.options.update(width=1000)
    if console.measure(table, options=endless).maximum > console.width:
        table.padding = (0, 1, 0, 0)  # before long names are broken
    console.print(table)


def _scan_name(row: Row) -> str:
    """The name of the file, and in a bag, which has many scans, the stamp."""
    file = Path(row["scan"])
    return f"{file.name} {row['stamp']}" if is_bag(file) else file.name


def _short(names: Sequence[str]) -> list[str]:
    """Names of files without their ending, where all have the same one."""
    endings = {ending_of(Path(name)) for name in names}
    cut = len(endings) == 1 and endings <= set(SCANS)
    return [name[: -len(*endings)] if cut else name for name in names]


def _location_cells(row: Row) -> list[str]:
    yaw = math.degrees(row["yaw"])
    position = [f"{row['x']:.2f}", f"{row['y']:.2f}", f"{yaw:.1f}"]
    return [*position, f"{row['fit']:.2f}", f"{row['ratio']:.2f}"]


def _trust(row: Row) -> str:
    """What the table says about trust: in the location, and in its refined pose."""
    told = _TRUST.get(row["doubt"], f"cannot tell: {row['doubt']}")
    return "; ".join([told, *(table_notes(row["refined"]) if "refined" in row else ())])


def print_lines(rows: Sequence[Row]) -> None:
    """Print one JSON object per line; an infinite ratio is null."""
    for row in rows:
        print_json("location", _values(row), indent=None)


def _content(place_map: Path, rows: Sequence[Row], failures: Sequence[str]) -> dict[str, Any]:
    """The one object of ``--as json``."""
    located = [_values(row) for row in rows]
    return {"map": place_map, "scans": located, "failures": list(failures)}


def _values(row: Row) -> Row:
    return {**row, "refined": json_values(row["refined"])} if "refined" in row else row


def print_csv(rows: Sequence[Row]) -> None:
    """Print CSV with a header, each row on one line."""
    names = ["scan", "stamp", *(field.name for field in fields(Location))]
    names += CSV if any("refined" in row for row in rows) else ()
    writer = csv.DictWriter(sys.stdout, names, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        texts = {"scan": printable(row["scan"]), "name": printable(row["name"])}
        refined = {} if "refined" not in row else csv_values(row.pop("refined"))
        writer.writerow({**row, **texts, **refined})


_PRINT = {"table": print_table, "jsonl": print_lines, "csv": print_csv}
