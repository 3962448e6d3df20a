"""Options of the commands about datasets: simulate, data and case-study."""

from pathlib import Path

from deepring.cli.options import add_form, add_format, add_metres, add_output, add_session
from deepring.cli.parser import Parser, number, subcommands, whole


def add_simulate(parser: Parser) -> None:
    """``deepring simulate nclt|mulran|custom -o FOLDER [KNOB=VALUE ...]``."""
    parser.add_argument("dataset", choices=("nclt", "mulran", "custom"))
    add_output(parser, "FOLDER", "the dataset's folder")
    parser.add_argument("--seed", type=whole(0), default=0, help="seed of the world (%(default)s)")
    parser.add_argument(
        "--workers", type=whole(1), default=2, help="number of processes (%(default)s)"
    )
    add_form(parser, "text")
    parser.add_argument("knobs", nargs="*", metavar="KNOB=VALUE")
    parser.runs("deepring.cli.simulate_command:simulate_command", root="--output")


def knobs_help() -> str:
    """The names of the simulation's settings, for the end of the help text."""
    from dataclasses import fields

    from deepring.simulation.settings import SimulationSettings

    return "knobs: " + ", ".join(field.name for field in fields(SimulationSettings))


def add_data(parser: Parser) -> None:
    """``deepring data check ROOT``."""
    checker = subcommands(parser)(
        "check",
        help="read every scan of a dataset, and say what is doubtful",
        description="Read every scan of a dataset, and report what each session holds, what is "
        "doubtful and what to change. Exits with 1 if something is doubtful or left out, and "
        "with 2 if a session cannot be used.",
    )
    checker.add_argument("root", type=Path, metavar="FOLDER")
    add_format(checker)
    add_session(checker, "check only this session")
    add_form(checker)
    checker.runs("deepring.cli.data_command:data_command")


def add_case_study(parser: Parser) -> None:
    """``deepring case-study DATASET | --format NAME FILE...``."""
    _add_scans(parser)
    parser.add_argument(
        "--pairs",
        type=whole(1),
        default=64,
        help="pairs of scans in the error curves (%(default)s)",
    )
    _add_methods(parser, "none")
    add_metres(parser, "--translation", 10.0, "metres between the pair in the figure")
    parser.add_argument(
        "--rotation",
        type=number(unit="degrees"),
        metavar="DEG",
        help="turn of the pair in the figure (random)",
    )
    _add_folder(parser, "outputs/case_study")
    add_form(parser)
    parser.runs("deepring.cli.case_study_command:case_study_command")


def add_properties(parser: Parser) -> None:
    """``deepring properties DATASET | --format NAME FILE...``."""
    _add_scans(parser)
    parser.add_argument(
        "--scans", type=whole(2), default=16, help="number of scans that are moved (%(default)s)"
    )
    _add_methods(parser, "all")
    _add_folder(parser, "outputs/properties")
    add_form(parser)
    parser.runs("deepring.cli.properties_command:properties_command")


def _add_scans(parser: Parser) -> None:
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="DATASET | FILE",
        help="a dataset's folder or drive.yaml, or scan files of different places (with --format)",
    )
    add_session(parser, "session of the dataset (the first)")
    add_format(parser)


def _add_methods(parser: Parser, default: str) -> None:
    parser.add_argument(
        "--methods",
        metavar="NAMES",
        help="methods of conf/method, separated by commas, or all of them in their CPU sizes; "
        f"networks have random weights ({default})",
    )
    parser.add_argument(
        "--checkpoint",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="a trained network beside them; may be given several times",
    )
    parser.add_argument("--seed", type=whole(0), default=0, help="random seed (%(default)s)")


def _add_folder(parser: Parser, default: str) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(default),
        metavar="FOLDER",
        help="where to write (%(default)s)",
    )
