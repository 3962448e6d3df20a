"""Methods as the command line names them: entries of ``conf/method``, and checkpoints."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, get_args

import torch

from deepring.errors import ConfigError
from deepring.experiment.config_groups import config_folder
from deepring.experiment.entries import Entry, method_entries
from deepring.experiment.every_method import Kind, every_method
from deepring.methods.method import Method
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import load_network

#: Every method, in place of names.
ALL = "all"


class NamedMethods(NamedTuple):
    """Methods, and what is to be known of them."""

    by_name: Mapping[str, Method]
    columns: Sequence[str]
    """Those of the points that some of the methods take."""
    left_out: Mapping[str, Sequence[str]]
    """Reason to the entries that ``all`` leaves out."""


def named_methods(
    names: str | None, checkpoints: Sequence[Path], columns: Sequence[str], seed: int
) -> NamedMethods:
    """The methods of ``names``, separated by commas, and the networks of ``checkpoints``.

    ``all`` is every method in its CPU size, without those that need columns of the points beyond
    ``columns``. Networks without a checkpoint have random weights, drawn from ``seed``.

    Raises:
        ConfigError: an unknown name, or a method that needs further columns.
        FileError: a checkpoint that cannot be read.
    """
    entries = {entry.name: entry for entry in method_entries(config_folder())}
    left_out: dict[str, Sequence[str]] = {}
    chosen = [] if not names else names.split(",")
    if chosen == [ALL]:
        chosen = []
        for kind in reversed(get_args(Kind)):
            choice = every_method(
                kind,
                [*entries.values()],
                lambda needed: {c: ["these scans"] for c in needed if c not in columns},
            )
            chosen += choice.names
            left_out |= choice.left_out
    methods: dict[str, Method] = {}
    for name in chosen:
        methods |= _of_entry(name, entries, columns, seed)
    for file in checkpoints:
        network = load_network(file).method
        _expect_columns(str(file), network.raster.columns, columns)
        methods[_free(network.settings.label, methods)] = network
    needed = {column for m in methods.values() for column in getattr(m.raster, "columns", ())}
    return NamedMethods(methods, sorted(needed), left_out)


def _of_entry(
    name: str, entries: Mapping[str, Entry], columns: Sequence[str], seed: int
) -> dict[str, Method]:
    """The method of one entry: by its label in tables, or a network by the entry's name."""
    if name not in entries:
        raise ConfigError(f"methods: {name!r}, expected {ALL}, or some of {', '.join(entries)}")
    _expect_columns(name, entries[name].columns, columns)
    from deepring.experiment import build  # imports Lightning
    from deepring.experiment.compose import composed

    node = composed([f"method={name}"]).method
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        method = build.method(node)
    if isinstance(method, NetworkMethod):
        return {f"{name}, untrained": method.eval()}
    return {str((node or {}).get("label", name)): method}


def _expect_columns(name: str, needed: Sequence[str], columns: Sequence[str]) -> None:
    missing = [column for column in needed if column not in columns]
    if missing:
        raise ConfigError(
            f"methods: {name} needs points with {missing[0]}s, which these scans lack; leave it "
            "out, or name a dataset that has them (docs: Downloads of datasets)"
        )


def _free(name: str, taken: Mapping[str, Method]) -> str:
    """The name, numbered if it is taken."""
    numbered = [name, *(f"{name} ({k})" for k in range(2, len(taken) + 3))]
    return next(each for each in numbered if each not in taken)
