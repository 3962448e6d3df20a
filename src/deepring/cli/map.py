"""`deepring map`: build a map of a drive, or look at one."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from deepring.cli.report import console
from deepring.data.formats import FORMATS, detect_format, ground_of, open_session
from deepring.data.scan import Session
from deepring.errors import DeepringError
from deepring.maps.map import Map
from deepring.methods.deepring import DeepRing
from deepring.progress import progress_bar
from deepring.search.correlation_index import SearchSettings
from deepring.search.spectra import Precision
from deepring.training.module import load_network


def map_command(arguments: Sequence[str]) -> None:
    """``deepring map build ROOT -o MAP``, ``deepring map info MAP``."""
    args = _parser().parse_args(arguments)
    if args.command == "build":
        build(args)
    else:
        info(args.map)


def build(args: argparse.Namespace) -> None:
    """A map of one session."""
    if args.output.exists():
        raise DeepringError(
            f"-o {args.output}: exists, expected a new file; nothing is overwritten: name another"
        )
    if args.spacing < 0:
        raise DeepringError(f"--spacing {args.spacing}: expected metres, at least 0")
    network = network_of(args.checkpoint)
    session, ground_z = open_drive(args)
    with progress_bar(f"{session.name}: describing places") as bar:
        built = Map.build(
            session,
            network,
            args.spacing,
            ground_z,
            bar,
            search=SearchSettings(args.precision),
        )
    built.save(args.output)
    show(args.output, built)


def info(path: Path) -> None:
    """What a map holds, after reading every byte of it."""
    show(path, Map.open(path, check=True))


def show(path: Path, held: Map) -> None:
    """Print what a map holds."""
    console.print(f"map          {path}, {path.stat().st_size / 1e6:.1f} MB")
    console.print(f"places       {len(held)}")
    if len(held):
        positions = held.poses[:, :2, 3].numpy()
        size = np.ptp(positions, axis=0)
        console.print(f"extent       {size[0]:.0f} m x {size[1]:.0f} m")
    settings = held.network.settings
    parameters = sum(p.numel() for p in held.network.parameters())
    console.print(f"network      {settings.label}, {parameters} parameters")
    console.print(f"descriptors  {held.index.settings.precision}")
    console.print(f"ground       {held.ground_z:g} m in the scans' frame")
    console.print(f"trust        fit {held.trust.fit:g}, ratio {held.trust.ratio:g}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("deepring map")
    commands = parser.add_subparsers(dest="command", required=True)
    builder = commands.add_parser("build", help="a map of one drive")
    add_drive(builder)
    builder.add_argument("-o", dest="output", type=Path, metavar="MAP", required=True)
    builder.add_argument("--spacing", type=float, default=10.0, help="metres between places (10)")
    builder.add_argument("--precision", choices=get_args(Precision), default="int8")
    shower = commands.add_parser("info", help="what a map holds; every byte is checked")
    shower.add_argument("map", type=Path)
    return parser


def add_drive(parser: argparse.ArgumentParser) -> None:
    """Options that say which drive, and what describes it."""
    parser.add_argument("root", type=Path, metavar="FOLDER", help="of the dataset, or drive.yaml")
    parser.add_argument("--checkpoint", type=Path, required=True, help="of a trained DeepRING")
    parser.add_argument("--format", choices=list(FORMATS), help="told from the folder by default")
    parser.add_argument("--session", help="where the folder holds several")
    parser.add_argument(
        "--ground-z",
        type=float,
        help="z of the ground under the sensor in the scans' frame, metres; the drive's own",
    )


def open_drive(args: argparse.Namespace) -> tuple[Session, float]:
    """The drive that `add_drive`'s options name, and z of the ground in its scans' frame."""
    format = args.format or detect_format(args.root)
    session = open_session(format, args.root, args.session)
    return session, ground_of(session, format) if args.ground_z is None else args.ground_z


def network_of(checkpoint: Path) -> DeepRing:
    """The network of a checkpoint. Raises DeepringError where it is another method's."""
    network = load_network(checkpoint).method
    if not isinstance(network, DeepRing):
        raise DeepringError(
            f"checkpoint {checkpoint}: of {network.settings.label}, expected DeepRING"
        )
    return network
