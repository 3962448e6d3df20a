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
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="DATASET | FILE",
        help="a dataset's folder or drive.yaml, or scan files of different places (with --format)",
    )
    add_session(parser, "session of the dataset (the first)")
    add_format(parser)
    parser.add_argument(
        "--pairs",
        type=whole(1),
        default=64,
        help="pairs of scans in the error curves (%(default)s)",
    )
    parser.add_argument("--seed", type=whole(0), default=0, help="random seed (%(default)s)")
    add_metres(parser, "--translation", 10.0, "metres between the pair in the figure")
    parser.add_argument(
        "--rotation",
        type=number(unit="degrees"),
        metavar="DEG",
        help="turn of the pair in the figure (random)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("outputs/case_study"),
        metavar="FOLDER",
        help="where to write (%(default)s)",
    )
    add_form(parser)
    parser.runs("deepring.cli.case_study_command:case_study_command")
