"""Options of the commands about deepring itself: doctor and schema."""

from pathlib import Path

from deepring.cli.options import add_form
from deepring.cli.parser import Parser


def add_doctor(parser: Parser) -> None:
    """``deepring doctor [--full]``."""
    parser.add_argument(
        "--full", action="store_true", help="with the home folder and the user's name in paths"
    )
    parser.add_argument(
        "--cache",
        type=Path,
        default=Path("outputs/cache"),
        metavar="FOLDER",
        help="the raster cache, paths.cache of trainings (%(default)s)",
    )
    add_form(parser, "text")
    parser.runs("deepring.cli.doctor_command:doctor_command")


def add_schema(parser: Parser) -> None:
    """``deepring schema [NAME]``."""
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="name of a schema; all names are listed without one"
    )
    parser.runs("deepring.cli.schema_command:schema_command", name="NAME")


def add_completion(parser: Parser) -> None:
    """``deepring completion SHELL``."""
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="one of %(choices)s")
    parser.runs("deepring.cli.completion_command:completion_command")
