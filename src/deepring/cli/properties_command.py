"""`deepring properties`: what methods bear, tell and cost, measured on scans."""

import argparse
from collections.abc import Sequence
from itertools import islice

import torch

from deepring.cli.console import console
from deepring.cli.named_methods import NamedMethods, named_methods
from deepring.cli.options import expect_folder
from deepring.cli.study_scans import expect_scans, readable, source_of
from deepring.cli.written_tables import write_shown, write_text
from deepring.errors import ConfigError
from deepring.experiment.every_method import left_out_text
from deepring.paper.properties import Properties, properties_of
from deepring.paper.properties_tables import number_table, shown_tables
from deepring.progress import progress_bar
from deepring.reports.table import csv, terminal


def properties_command(args: argparse.Namespace) -> None:
    """Measure the methods on the same scans, print their tables, and write them."""
    expect_folder(args.output)
    source = source_of(args.paths, args.format, args.session)
    names = args.methods or ("" if args.checkpoint else "all")
    methods = named_methods(names, args.checkpoint, source.columns, args.seed)
    if not methods.by_name:
        raise ConfigError("methods: none, expected at least one; name one")
    complaints: list[str] = []
    scans = list(islice(readable(source, args.seed, complaints, methods.columns), args.scans))
    expect_scans(source, scans, complaints)
    rows: list[Properties] = []
    for name, method in methods.by_name.items():
        with progress_bar(f"{name}: moving scans") as progress:
            rows.append(
                properties_of(
                    name, method, scans, source.ground_z, methods.columns, args.seed, progress
                )
            )
    conditions = f": {source.title}, {len(scans)} scans, seed {args.seed}"
    tables = shown_tables(rows, conditions, _notes(methods, complaints))
    console.print(terminal(tables))
    for name, table in zip(("borne", "told"), tables, strict=True):
        write_shown(f"properties_{name}", table, args.output)
    write_text(args.output / "properties.csv", csv(number_table(rows)))


def _notes(methods: NamedMethods, complaints: Sequence[str]) -> list[str]:
    notes = [f"times on a CPU, {torch.get_num_threads()} thread(s), other programs not excluded"]
    if methods.left_out:
        notes.append(left_out_text(methods.left_out))
    if complaints:
        notes.append(f"left out {len(complaints)} broken scans (first: {complaints[0]})")
    return notes
