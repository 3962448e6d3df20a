"""`deepring properties`: what methods bear, tell and cost, measured on scans."""

import argparse
from collections.abc import Sequence
from itertools import islice

import torch

from deepring.cli.json_output import print_json
from deepring.cli.named_methods import NamedMethods, named_methods
from deepring.cli.options import expect_folder
from deepring.cli.shown_tables import ShownTables
from deepring.cli.study_scans import expect_scans, readable, source_of
from deepring.errors import ConfigError
from deepring.experiment.every_method import left_out_text
from deepring.paper.properties import Properties, properties_of
from deepring.paper.properties_tables import number_table, shown_tables
from deepring.progress import progress_bar


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
    about = f": {source.title}, {len(scans)} scans, seed {args.seed}"
    tables = shown_tables(rows, about, _notes(methods, complaints))
    output = ShownTables(args.output, quiet=args.form == "json")
    output.print(tables)
    for name in output.shown:
        output.write_shown(name)
    output.write_numbers("properties", number_table(rows))
    if args.form == "json":
        conditions = {"source": source.title, "scans": len(scans), "seed": args.seed}
        print_json("properties", conditions | output.content())


def _notes(methods: NamedMethods, complaints: Sequence[str]) -> list[str]:
    notes = [f"times on a CPU, {torch.get_num_threads()} thread(s), other programs not excluded"]
    if methods.left_out:
        notes.append(left_out_text(methods.left_out))
    if complaints:
        notes.append(f"left out {len(complaints)} broken scans (first: {complaints[0]})")
    return notes
