"""Options that several commands share: a drive, a network, a new file."""

import argparse
import errno
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deepring.cli.notices import say_skipped, warn
from deepring.cli.parser import Names, Parser, number
from deepring.errors import ConfigError, DataError, FileError
from deepring.io.files import part_of

if TYPE_CHECKING:
    from deepring.data.recording import Recording
    from deepring.data.session import Session
    from deepring.methods.deepring import DeepRing

FORMATS = "deepring.data.readers:reader_names"


def add_format(
    parser: Parser, what: str = "format of the dataset, recognised from the folder by default"
) -> None:
    """``--format``, one of the dataset formats."""
    parser.add_argument(
        "--format", choices=Names(FORMATS), metavar="NAME", help=f"{what}: %(choices)s"
    )


def add_drive(parser: Parser, what: str = "folder of the dataset, or a drive.yaml") -> None:
    """The options that name a drive."""
    parser.add_argument("root", type=Path, metavar="FOLDER", help=what)
    add_format(parser)
    add_session(parser, "session, if the folder holds several")
    add_ground(parser, "the drive's")


def add_session(parser: Parser, help: str) -> None:
    """``--session``, which the library calls the ``name`` of a session."""
    parser.add_argument("--session", help=help)
    parser.flags["name"] = "--session"


def add_ground(parser: Parser, default: str) -> None:
    """``--ground-z``, whose default is ``default``'s value."""
    parser.add_argument(
        "--ground-z",
        type=number(unit="metres"),
        metavar="M",
        help=f"z of the ground under the sensor in the scans' frame, metres ({default} by default)",
    )


def add_network(parser: Parser) -> None:
    """The option that names the network which describes the scans."""
    parser.add_argument(
        "--checkpoint",
        default="shipped",
        metavar="FILE",
        help="a trained DeepRING, .ckpt or .safetensors (the one that comes with the package)",
    )


def add_method(parser: Parser) -> None:
    """``--method``, the class of a method that is not registered."""
    parser.add_argument(
        "--method",
        metavar="MODULE.CLASS",
        help="class of the method, if it is your own",
    )


def add_metres(parser: Parser, flag: str, default: float, help: str) -> None:
    """A length of at least 0 metres; the default stands behind ``help``."""
    parser.add_argument(
        flag,
        type=number(0, "metres"),
        default=default,
        metavar="M",
        help=f"{help} (%(default)g)",
    )


def add_form(parser: Parser, text: str = "table", further: Sequence[str] = ()) -> None:
    """``--as``: ``text``, the name of what a person reads, or JSON, or one of the further forms."""
    parser.add_argument(
        "--as",
        dest="form",
        choices=(text, "json", *further),
        default=text,
        help="output format: %(choices)s (%(default)s)",
    )


def add_output(parser: Parser, metavar: str, help: str, required: bool = True) -> None:
    """``-o``, the file or folder to write."""
    parser.add_argument("-o", "--output", type=Path, metavar=metavar, required=required, help=help)


def open_drive(args: argparse.Namespace) -> "tuple[Session, float, tuple[str, ...]]":
    """The drive that `add_drive`'s options name, z of the ground in its scans' frame, and doubts.

    Warns of what is left out and of what is doubtful. Raises DataError for an unusable drive.
    """
    from deepring.data.inspection.session import expect_usable
    from deepring.data.readers import detect_format, ground_of, open_session

    format = args.format or detect_format(args.root)
    session = open_session(format, args.root, args.session)
    say_skipped(session)
    ground_z = ground_of(session, format) if args.ground_z is None else args.ground_z
    doubts = tuple(f"session {session.name}: {one}" for one in expect_usable(session, ground_z))
    for doubt in doubts:
        warn(doubt)
    return session, ground_z, doubts


def ground_in(recording: "Recording", ground_z: float | None) -> "tuple[float, tuple[str, ...]]":
    """z of the ground in the scans of a recording, as given or as the scans show it, and doubts.

    Warns of what is left out and of what is doubtful. Raises DataError for an unusable recording.
    """
    from deepring.data.inspection.recording import inspect_recording

    say_skipped(recording)
    ground_z, findings = inspect_recording(recording, ground_z)
    doubts = tuple(f"session {recording.name}: {one}" for one in findings)
    for doubt in doubts:
        warn(doubt)
    return ground_z, doubts


def network_of(checkpoint: str) -> "DeepRing":
    """The network of a checkpoint. Raises DataError if it is of another method than DeepRING."""
    from deepring.methods.deepring import DeepRing
    from deepring.methods.network_file import load_network

    network = load_network(checkpoint).method
    if not isinstance(network, DeepRing):
        raise DataError(
            f"checkpoint: {checkpoint} holds {network.settings.label}, expected DeepRING, which "
            f"maps are made with; `deepring evaluate checkpoint={checkpoint}` takes every network"
        )
    return network


def expect_meant(args: argparse.Namespace, **whats: str | None) -> None:
    """Raise ConfigError for an option that has no part in what is given.

    ``whats`` say, by the names of options, what they need; None where it is there.
    """
    for name, what in whats.items():
        value = getattr(args, name)
        if what is not None and value is not None and value != [] and value != 1:
            shown = ", ".join(value) if isinstance(value, list) else value
            raise ConfigError(
                f"{name}: {shown}, expected only with {what}, which is not given: leave it out"
            )


def expect_new(path: Path, argument: str = "output") -> None:
    """Raise FileError if the file exists, so that nothing is overwritten, or cannot be written.

    ``argument`` is the library's name of the option.
    """
    if os.path.lexists(path):
        raise FileError(
            f"{argument}: {path} exists, expected a new file; nothing is overwritten: name "
            "another one"
        )
    expect_writable(path, argument)


def expect_folder(path: Path) -> None:
    """Raise FileError unless files can be written below the path, a folder or one to be made."""
    if path.exists() and not path.is_dir():
        raise FileError(f"output: {path} is a file, expected a folder to write to")
    expect_writable(path)


def expect_writable(path: Path, argument: str = "output") -> None:
    """Raise FileError unless a file or folder can be written at the path, before any work is done.

    Folders above it that are missing are not made yet. Nothing is left behind.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise FileError(f"{argument}: {path}, expected a name in UTF-8; name another one") from None
    above = path.absolute() if path.is_dir() else path.absolute().parent
    try:
        part_of(path).exists()  # raises where the name is too long
        while not above.exists():
            above = above.parent
        with tempfile.TemporaryFile(dir=above):
            pass
    except OSError as error:
        reason = {
            errno.ENAMETOOLONG: "its name is too long",
            errno.ENOTDIR: f"{above} is a file",
            errno.ENOSPC: f"no space is left in {above}",
        }.get(error.errno or 0, f"no file can be made in {above}")
        raise FileError(
            f"{argument}: {path} cannot be written: {reason}; name another one"
        ) from error


def add_looking(parser: Parser, page: bool = True) -> None:
    """``--page``, ``--view`` and ``--view-file``."""
    if page:
        parser.add_argument(
            "--page",
            type=Path,
            metavar="FILE",
            help="write a page to look at, .html, of one file",
        )
    parser.add_argument(
        "--view", action="store_true", help="open the viewer of rerun (needs deepring[view])"
    )
    parser.add_argument(
        "--view-file",
        type=Path,
        metavar="FILE",
        help="write a file for the viewer of rerun, .rrd (needs deepring[view])",
    )
