"""`deepring localize`: where scans were taken, as a table, JSON lines or CSV."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from rich.table import Table

from deepring.cli.report import console
from deepring.data.scan_files import BINARY, read_scan, scan_files
from deepring.errors import DeepringError
from deepring.maps.map import Location, Map
from deepring.progress import progress_bar

#: A row: the scan's file, and where it was taken.
Row = dict[str, Any]


def localize_command(arguments: Sequence[str]) -> None:
    """``deepring localize MAP SCAN... [--format kitti] [--as table|json|csv]``.

    Exits with 1 where a scan cannot be located; the others are all the same.
    """
    args = _parser().parse_args(arguments)
    files = scan_files(args.scans)
    held = Map.open(args.map, check=not args.unchecked)
    failed: list[str] = []
    with progress_bar("locating") as bar:
        rows = list(locate(held, files, args.format, failed, bar))
    if rows or not failed:
        _PRINT[args.form](rows)
    for message in failed:
        print(f"error: {message}", file=sys.stderr)
    if failed:
        sys.exit(1)


def locate(
    held: Map,
    files: Sequence[Path],
    binary: str | None,
    failed: list[str],
    progress: Callable[[int, int], None],
) -> Iterator[Row]:
    """A row a scan; what is wrong with the others goes to ``failed``."""
    for number, file in enumerate(files, start=1):
        try:
            yield {"scan": str(file), **asdict(held.localize(read_scan(file, binary)))}
        except DeepringError as error:
            message = str(error)
            failed.append(message if str(file) in message else f"{file}: {message}")
        progress(number, len(files))


def print_table(rows: Sequence[Row]) -> None:
    """For people."""
    table = Table(box=None, header_style="bold")
    for name in ("scan", "x m", "y m", "yaw °", "fit", "ratio", "trusted", "found by"):
        table.add_column(name, justify="left" if name in ("scan", "found by") else "right")
    for row in rows:
        table.add_row(
            Path(row["scan"]).name,
            f"{row['x']:.2f}",
            f"{row['y']:.2f}",
            f"{math.degrees(row['yaw']):.1f}",
            f"{row['fit']:.2f}",
            f"{row['ratio']:.2f}",
            "yes" if row["trusted"] else "no",
            row["name"],
        )
    console.print(table)


def print_json(rows: Sequence[Row]) -> None:
    """One object a line; a ratio without a rival is null."""
    for row in rows:
        finite = {
            name: None if isinstance(value, float) and math.isinf(value) else value
            for name, value in row.items()
        }
        print(json.dumps(finite))


def print_csv(rows: Sequence[Row]) -> None:
    """With a header."""
    names = ["scan", *(field.name for field in fields(Location))]
    writer = csv.DictWriter(sys.stdout, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)


_PRINT = {"table": print_table, "json": print_json, "csv": print_csv}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "deepring localize",
        description="Where scans were taken in a map: position and heading in the world of its "
        "poses, and whether to trust them.",
    )
    parser.add_argument("map", type=Path, metavar="MAP")
    parser.add_argument("scans", type=Path, nargs="+", metavar="SCAN", help="files or folders")
    parser.add_argument("--format", choices=list(BINARY), help="what .bin files hold")
    parser.add_argument("--as", dest="form", choices=list(_PRINT), default="table")
    parser.add_argument(
        "--unchecked", action="store_true", help="do not read the whole map to see if it is sound"
    )
    return parser
