"""`deepring case-study`: how representations change with rotation and translation, and methods."""

import argparse
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from deepring.cli.console import console
from deepring.cli.json_output import print_as
from deepring.cli.named_methods import NamedMethods, named_methods
from deepring.cli.options import expect_folder
from deepring.cli.study_scans import Source, expect_scans, readable, source_of
from deepring.data.session import Points
from deepring.errors import ConfigError
from deepring.experiment.every_method import left_out_text
from deepring.paper.case_study import (
    ErrorRow,
    Kind,
    TwinPair,
    case_pair,
    measure,
    write_errors,
)
from deepring.paper.case_study_figures import error_figure, pair_figure
from deepring.paper.method_curves import curves_figure, method_rows
from deepring.paper.moved_scans import Motion, Position, Scan
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


def case_study_command(args: argparse.Namespace) -> None:
    """Write figures and CSV files, and print a summary."""
    _check(args)
    source = source_of(args.paths, args.format, args.session)
    methods = named_methods(args.methods, args.checkpoint, source.columns, args.seed)
    complaints: list[str] = []
    scans = readable(source, args.seed, complaints, methods.columns)
    first = list(islice(scans, 1))
    expect_scans(source, first, complaints)
    pair = case_pair(first[0].points[:, :3], _motion(args), source.ground_z, args.seed)
    repeats = math.ceil(args.pairs / len(source.files))
    taken: list[Scan] = []  # by the representations, and by the methods once more
    with progress_bar("moving scans") as progress:
        usable = _noted(chain(first, scans), taken if methods.by_name else None)
        rows = measure(usable, source.ground_z, args.pairs, repeats, args.seed, progress)
    figures = {
        "case_study.png": pair_figure(pair),
        "case_study_error.png": error_figure(rows, source.title),
    }
    of_methods = _method_rows(source, methods, taken, repeats, args)
    if of_methods:
        figures["case_study_methods.png"] = curves_figure(of_methods, source.title)
    for name, figure in figures.items():
        save(figure, args.output / name)
    tables = {"case_study.csv": rows, "case_study_methods.csv": of_methods}
    written = [*figures, *(name for name, of in tables.items() if of)]
    for name, of in tables.items():
        if of:
            write_errors(args.output / name, of)

    def text() -> None:
        _report(source, pair, rows, complaints)
        if of_methods:
            _report_methods(of_methods, methods.left_out)
        console.print(f"written      {args.output}/{', '.join(written)}")

    paths = [args.output / name for name in written]
    content = partial(_content, source, pair, rows, of_methods, complaints, paths)
    print_as(args, "case_study", content, text)


def _noted(
    scans: Iterable[Scan], taken: list[Scan] | None
) -> Iterator[tuple[Points, Position | None]]:
    """The scans as `measure` takes them; each that is taken is noted."""
    for scan in scans:
        if taken is not None:
            taken.append(scan)
        yield scan.points[:, :3], scan.place.position


def _method_rows(
    source: Source,
    methods: NamedMethods,
    taken: Sequence[Scan],
    repeats: int,
    args: argparse.Namespace,
) -> list[ErrorRow]:
    """What each method loses, on the scans of the representations."""
    scans = [scan for scan in taken for _ in range(repeats)][: args.pairs]
    rows: list[ErrorRow] = []
    for name, method in methods.by_name.items():
        with progress_bar(f"{name}: moving scans") as progress:
            rows += method_rows(
                name, method, scans, source.ground_z, methods.columns, args.seed, progress
            )
    return rows


def _check(args: argparse.Namespace) -> None:
    reach = BevRaster().extent
    if args.translation > reach:
        raise ConfigError(
            f"translation: {args.translation:g}, expected metres from 0 to {reach:g}; beyond that "
            "a scan leaves its own view"
        )
    expect_folder(args.output)


def _motion(args: argparse.Namespace) -> Motion:
    rng = np.random.default_rng(args.seed)
    yaw, direction = rng.uniform(0, 360), rng.uniform(0, 2 * math.pi)
    shift = args.translation * math.cos(direction), args.translation * math.sin(direction)
    return Motion(yaw if args.rotation is None else args.rotation, shift)


def _content(
    source: Source,
    pair: TwinPair,
    rows: Sequence[ErrorRow],
    of_methods: Sequence[ErrorRow],
    complaints: Sequence[str],
    written: Sequence[Path],
) -> dict[str, Any]:
    """What the command tells, for the schema ``case_study``."""
    return {
        "source": source.title,
        "format": source.format,
        "pairs": rows[0].n,
        "errors": [asdict(row) for row in rows],
        "methods": [asdict(row) for row in of_methods],
        "pair": {
            "yaw_deg": float(pair.motion.yaw_deg),
            "metres": math.hypot(*pair.motion.shift),
            "errors": {view.name: float(view.error) for view in pair.views},
        },
        "left_out": list(complaints),
        "written": list(written),
    }


def _report(
    source: Source, pair: TwinPair, rows: Sequence[ErrorRow], complaints: Sequence[str]
) -> None:
    console.print(f"{source.title}: {rows[0].n} pairs, at random headings")
    columns = _print_means("mean error", rows)
    metres = math.hypot(*pair.motion.shift)
    errors = ", ".join(f"{view.name} {view.error:.3f}" for view in pair.views)
    console.print(f"drawn pair   turned {pair.motion.yaw_deg:.1f}°, moved {metres:g} m: {errors}")
    if columns < len(COLUMNS):
        console.print("unrelated    left out: no two scans of places far enough apart")
    if complaints:
        console.print(f"left out     {len(complaints)} broken scans (first: {complaints[0]})")


def _report_methods(rows: Sequence[ErrorRow], left_out: Mapping[str, Sequence[str]]) -> None:
    _print_means("mean loss", rows)
    console.print("loss         0: as the scan itself, 1: as an unrelated scan")
    if left_out:
        console.print(left_out_text(left_out).replace("left out", "left out    ", 1))


def _print_means(title: str, rows: Sequence[ErrorRow]) -> int:
    """Print the means of each representation or method; return the number of columns."""
    means = {(row.representation, row.kind, row.value): row for row in rows}
    names = list(dict.fromkeys(row.representation for row in rows))
    columns = [column for column in COLUMNS if (names[0], column[0], column[1]) in means]
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(title)
    for *_, header in columns:
        table.add_column(header, justify="right")
    for name in names:
        cells = (f"{means[name, kind, value].mean:.3f}" for kind, value, _ in columns)
        table.add_row(name, *cells)
    console.print(table)
    return len(columns)
