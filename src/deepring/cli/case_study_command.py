"""`deepring case-study`: how SG and PG change with rotation and translation."""

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from deepring.cli.console import console
from deepring.cli.json_output import print_as
from deepring.cli.options import expect_folder
from deepring.data.readers import (
    binary_formats,
    detect_format,
    ground_of,
    list_sessions,
    open_session,
)
from deepring.data.readers.custom.drive_file import is_drive_file
from deepring.data.scans.returns import scan_from
from deepring.data.session import Points
from deepring.errors import BrokenScanError, ConfigError, DataError, FileError
from deepring.paper.case_study import (
    NAMES,
    ErrorRow,
    Kind,
    Motion,
    Position,
    TwinPair,
    case_pair,
    measure,
    write_errors,
)
from deepring.paper.case_study_figures import error_figure, pair_figure
from deepring.progress import progress_bar
from deepring.rasters import BevRaster
from deepring.reports.style import save

#: The columns of the summary: kind, value, header. 52.5° lies half-way between two rows.
COLUMNS: tuple[tuple[Kind, float | None, str], ...] = (
    ("translation", 5.0, "5 m"),
    ("translation", 10.0, "10 m"),
    ("translation", 20.0, "20 m"),
    ("rotation", 45.0, "45°, 15 rows"),
    ("rotation", 52.5, "52.5°, 17.5 rows"),
    ("unrelated", None, "unrelated"),
)


#: What the command writes.
FILES = ("case_study.png", "case_study_error.png", "case_study.csv")


class Source(NamedTuple):
    """Scan files, with the positions of their scans."""

    title: str
    format: str
    read: Callable[[Path], Points]
    ground_z: float
    files: Sequence[Path]
    positions: NDArray[np.float64] | None  # (n, 2) metres; None for scans without poses


def case_study_command(args: argparse.Namespace) -> None:
    """Write two figures and a CSV file, and print a summary."""
    _check(args)
    source = _source(args.paths, args.format, args.session)
    complaints: list[str] = []
    scans = _readable(source, args.seed, complaints)
    first = next(scans, None)
    if first is None:
        raise DataError(
            f"{source.title}: none of its {len(source.files)} scans can be used "
            f"(first: {complaints[0]})"
        )
    pair = case_pair(first[0], _motion(args), source.ground_z, args.seed)
    repeats = math.ceil(args.pairs / len(source.files))
    with progress_bar("moving scans") as progress:
        usable = chain([first], scans)
        rows = measure(usable, source.ground_z, args.pairs, repeats, args.seed, progress)
    figures = {
        "case_study.png": pair_figure(pair),
        "case_study_error.png": error_figure(rows, source.title),
    }
    for name, figure in figures.items():
        save(figure, args.output / name)
    write_errors(args.output / "case_study.csv", rows)
    content = partial(_content, source, pair, rows, complaints, args.output)
    text = partial(_report, source, pair, rows, complaints, args.output)
    print_as(args, "case_study", content, text)


def _check(args: argparse.Namespace) -> None:
    reach = BevRaster().extent
    if args.translation > reach:
        raise ConfigError(
            f"translation: {args.translation:g}, expected metres from 0 to {reach:g}; beyond that "
            "a scan leaves its own view"
        )
    expect_folder(args.output)


def _source(paths: Sequence[Path], format: str | None, session: str | None) -> Source:
    if len(paths) == 1 and (is_drive_file(paths[0]) or not paths[0].is_file()):
        return _dataset(paths[0], format, session)
    missing = [str(path) for path in paths if not path.is_file()]
    if missing:
        raise FileError(f"{missing[0]}: not a file, expected one dataset, or only scan files")
    formats = binary_formats()
    if format is None or format not in formats:
        raise ConfigError(
            f"{paths[0]}: a scan file without its format, expected it; give --format, one of "
            + ", ".join(formats)
        )
    if session is not None:
        raise ConfigError(
            f"--session {session}: expected only with the folder of a dataset; leave it out"
        )
    if len({path.resolve() for path in paths}) < len(paths):
        raise ConfigError("FILE: the same file twice, expected scans of different places")
    title = ", ".join(path.name for path in paths)
    scans = formats[format]
    return Source(title, format, scans.read, scans.ground_z, paths, None)


def _dataset(root: Path, format: str | None, name: str | None) -> Source:
    format = format or detect_format(root)
    names = list_sessions(format, root)
    if name is not None and name not in names:
        raise ConfigError(f"--session {name}: not in {root}, expected one of {', '.join(names)}")
    session = open_session(format, root, name or names[0])
    folder = root.resolve().name
    title = folder if folder == session.name else f"{folder}, {session.name}"
    ground_z = ground_of(session, format)
    return Source(title, format, session.read, ground_z, session.files, session.positions)


def _readable(
    source: Source, seed: int, complaints: list[str]
) -> Iterator[tuple[Points, Position | None]]:
    """The scans of a dataset in random order; messages about broken ones go to ``complaints``.

    Scan files keep their order, and a broken one is an error.
    """
    order = list(range(len(source.files)))
    if source.positions is not None:
        order = np.random.default_rng(seed).permutation(order).tolist()
    for k in order:
        try:
            points = _points(source, source.files[k])
        except BrokenScanError as error:
            if source.positions is None:
                raise
            complaints.append(str(error))
            continue
        yield points, None if source.positions is None else source.positions[k]


def _points(source: Source, file: Path) -> Points:
    """The points of a scan. Raises BrokenScanError if none of them is in the bird's-eye view."""
    points = scan_from(source.read(file), file).points
    bev = BevRaster()
    if not bev(points, source.ground_z).any():
        raise BrokenScanError(
            f"{file}: {len(points)} points as {source.format}, expected some above the ground "
            f"within {bev.extent:g} m; check the file and --format"
        )
    return points


def _motion(args: argparse.Namespace) -> Motion:
    rng = np.random.default_rng(args.seed)
    yaw, direction = rng.uniform(0, 360), rng.uniform(0, 2 * math.pi)
    shift = args.translation * math.cos(direction), args.translation * math.sin(direction)
    return Motion(yaw if args.rotation is None else args.rotation, shift)


def _content(
    source: Source,
    pair: TwinPair,
    rows: Sequence[ErrorRow],
    complaints: Sequence[str],
    output: Path,
) -> dict[str, Any]:
    """What the command tells, for the schema ``case_study``."""
    return {
        "source": source.title,
        "format": source.format,
        "pairs": rows[0].n,
        "errors": [asdict(row) for row in rows],
        "pair": {
            "yaw_deg": float(pair.motion.yaw_deg),
            "metres": math.hypot(*pair.motion.shift),
            "errors": {view.name: float(view.error) for view in pair.views},
        },
        "left_out": list(complaints),
        "written": [output / name for name in FILES],
    }


def _report(
    source: Source,
    pair: TwinPair,
    rows: Sequence[ErrorRow],
    complaints: Sequence[str],
    output: Path,
) -> None:
    means = {(row.representation, row.kind, row.value): row for row in rows}
    columns = [column for column in COLUMNS if (NAMES[0], column[0], column[1]) in means]
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("mean error")
    for *_, header in columns:
        table.add_column(header, justify="right")
    for name in NAMES:
        cells = (f"{means[name, kind, value].mean:.3f}" for kind, value, _ in columns)
        table.add_row(name, *cells)
    console.print(f"{source.title}: {rows[0].n} pairs, at random headings")
    console.print(table)
    metres = math.hypot(*pair.motion.shift)
    errors = ", ".join(f"{view.name} {view.error:.3f}" for view in pair.views)
    console.print(f"drawn pair   turned {pair.motion.yaw_deg:.1f}°, moved {metres:g} m: {errors}")
    if len(columns) < len(COLUMNS):
        console.print("unrelated    left out: no two scans of places far enough apart")
    if complaints:
        console.print(f"left out     {len(complaints)} broken scans (first: {complaints[0]})")
    console.print(f"written      {output}/{', '.join(FILES)}")
