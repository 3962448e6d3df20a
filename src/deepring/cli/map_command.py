"""`deepring map`: build a map of a drive, look at one, or tell when to trust it."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from deepring.cli.console import console
from deepring.data.readers import detect_format, ground_of, open_session, reader_names
from deepring.data.session import Points, Session
from deepring.data.spacing import sample_by_distance
from deepring.errors import DeepringError
from deepring.localization.calibration import Right, calibrate, try_out
from deepring.localization.map import Map
from deepring.methods.checkpoint import load_network
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import SHIPPED
from deepring.progress import Progress, progress_bar
from deepring.search.correlation_index import SearchSettings
from deepring.search.spectra import Precision


def map_command(arguments: Sequence[str]) -> None:
    """``deepring map build FOLDER -o MAP``, ``info MAP``, ``calibrate MAP FOLDER -o MAP``."""
    args = _parser().parse_args(arguments)
    {"build": build, "info": info, "calibrate": calibrate_map}[args.command](args)


def build(args: argparse.Namespace) -> None:
    """A map of one session."""
    expect_new(args.output)
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


def info(args: argparse.Namespace) -> None:
    """What a map holds, after reading every byte of it."""
    show(args.map, Map.open(args.map, check=True))


def calibrate_map(args: argparse.Namespace) -> None:
    """The same map with thresholds that reach a precision on another drive."""
    expect_new(args.output)
    held = Map.open(args.map, check=True)
    session, ground_z = open_drive(args)
    everywhere = np.ones(len(session.files), dtype=np.bool_)
    scans = sample_by_distance(session.positions, args.spacing, everywhere)
    with progress_bar(f"{session.name}: locating") as bar:
        trials = try_out(held, scans_of(session, scans, bar), ground_z)
    found = calibrate(trials, args.precision, Right(metres=args.within))
    held.trust = found.trust
    held.save(args.output)
    console.print(f"written      {args.output}", markup=False)
    console.print(f"trust        fit {found.trust.fit:g}, ratio {found.trust.ratio:.3f}")
    console.print(f"precision    {found.precision:.3f} of {found.trusted} trusted")
    console.print(f"recall       {found.recall:.3f}, of {found.scans} scans those near the map")


def scans_of(
    session: Session, scans: NDArray[np.int64], progress: Progress
) -> Iterator[tuple[Points, NDArray[np.float64]]]:
    """Points and poses of some scans."""
    for done, k in enumerate(scans.tolist(), start=1):
        yield session.points(k), session.poses[k]
        progress(done, len(scans))


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
    add_network(builder)
    builder.add_argument("-o", dest="output", type=Path, metavar="MAP", required=True)
    builder.add_argument("--spacing", type=float, default=10.0, help="metres between places (10)")
    builder.add_argument("--precision", choices=get_args(Precision), default="int8")
    shower = commands.add_parser("info", help="what a map holds; every byte is checked")
    shower.add_argument("map", type=Path)
    judge = commands.add_parser(
        "calibrate", help="set when to trust a map, by another drive in its world"
    )
    judge.add_argument("map", type=Path, metavar="MAP")
    add_drive(judge)
    judge.add_argument("-o", dest="output", type=Path, metavar="MAP", required=True)
    judge.add_argument(
        "--precision", type=float, default=0.99, help="share of trusted that is right (0.99)"
    )
    judge.add_argument(
        "--within", type=float, default=2.0, help="metres to the truth that are right (2)"
    )
    judge.add_argument("--spacing", type=float, default=5.0, help="metres between scans (5)")
    return parser


def expect_new(path: Path) -> None:
    """Refuse to overwrite."""
    if path.exists():
        raise DeepringError(
            f"-o {path}: exists, expected a new file; nothing is overwritten: name another"
        )


def add_drive(parser: argparse.ArgumentParser) -> None:
    """Options that say which drive."""
    parser.add_argument("root", type=Path, metavar="FOLDER", help="of the dataset, or drive.yaml")
    parser.add_argument("--format", choices=reader_names(), help="told from the folder by default")
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


def add_network(parser: argparse.ArgumentParser) -> None:
    """The option that says what describes scans."""
    parser.add_argument(
        "--checkpoint",
        default=SHIPPED,
        metavar="FILE",
        help="a trained DeepRING, .ckpt or .safetensors; the one that comes with the package",
    )


def network_of(checkpoint: str) -> DeepRing:
    """The network of a checkpoint. Raises DeepringError where it is another method's."""
    network = load_network(checkpoint).method
    if not isinstance(network, DeepRing):
        raise DeepringError(
            f"checkpoint {checkpoint}: of {network.settings.label}, expected DeepRING"
        )
    return network
