"""Options of the commands about runs: train, evaluate, compare, score, tables and report."""

import argparse
from pathlib import Path
from textwrap import wrap

from deepring.cli.options import add_method, add_output
from deepring.cli.parser import Parser, number, whole

#: Revisit radii in metres that `score` counts at, the headline first.
RADII = "10,5,15,20,25"

#: Columns of the terminal that the options of a group are wrapped to.
_WIDTH = 100

_HYDRA = """\
KEY=VALUE sets a value, GROUP=NAME takes a file of a group, such as data.root=FOLDER or
method=ring; ~GROUP takes none, test=[A,B] several. --cfg job prints the config that is composed,
--info config where it comes from.

groups and their options (* by default):
"""


def add_train(parser: Parser) -> None:
    """``deepring train [-m] [KEY=VALUE ...]``."""
    parser.add_argument(
        "-m", "--multirun", action="store_true", help="run a sweep over comma-separated values"
    )
    _add_overrides(parser, "train")


def add_evaluate(parser: Parser) -> None:
    """``deepring evaluate [checkpoint=FILE] [KEY=VALUE ...]``."""
    _add_overrides(parser, "evaluate")


def _add_overrides(parser: Parser, name: str) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    parser.runs(f"deepring.cli.train_commands:{name}_command")


def config_help(command: str) -> str:
    """The groups of ``conf/`` with their options and defaults, for the end of a help text."""
    from deepring.experiment.config_groups import chosen_options, config_folder, group_options

    folder = config_folder()
    chosen, options = chosen_options(folder, command), group_options(folder)
    # What belongs to a method can be chosen wherever the method can.
    groups = [group for group in options if group.partition("/")[0] in chosen]
    width = max(map(len, groups)) + 2
    lines = []
    for group in groups:
        names = [f"{name}*" if name == chosen.get(group) else name for name in options[group]]
        first, *rest = wrap(" ".join(names), _WIDTH - width - 2, break_long_words=False)
        lines += [f"  {group:<{width}}{first}", *(f"  {'':<{width}}{line}" for line in rest)]
    return _HYDRA + "\n".join(lines)


def add_compare(parser: Parser) -> None:
    """``deepring compare [KEY=VALUE ...]``."""
    parser.add_argument(
        "--learned", metavar="METHODS", help="of conf/method; the CPU-sized four by default"
    )
    parser.add_argument(
        "--fixed",
        metavar="METHODS",
        help="methods that learn nothing; RING, RING++ and both Scan Contexts by default",
    )
    parser.add_argument(
        "--train", metavar="DATASETS", help="to train on, one after the other; two by default"
    )
    parser.add_argument("--test", metavar="DATASETS", help="to test on, all; two by default")
    parser.add_argument("--seeds", metavar="SEEDS", help="0,1 by default")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    parser.runs("deepring.cli.compare_command:compare_command")


def add_score(parser: Parser) -> None:
    """``deepring score FOLDER``."""
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="a run's folder, or that of its descriptors"
    )
    parser.add_argument(
        "--radii",
        type=_radii,
        default=RADII,
        metavar="M,M,...",
        help="revisit radii in metres, the headline first (%(default)s)",
    )
    _add_over(parser)
    add_method(parser)
    add_output(parser, "FILE", "also write the results as CSV", required=False)
    parser.runs("deepring.cli.score_command:score_command", own_class="--method")


def add_tables(parser: Parser) -> None:
    """``deepring tables PATH...``."""
    parser.add_argument(
        "paths", type=Path, nargs="+", metavar="PATH", help="folder of a sweep, or of a run"
    )
    parser.add_argument(
        "--radius", type=number(0, "metres"), default=10.0, metavar="M", help="metres (%(default)g)"
    )
    _add_over(parser)
    parser.add_argument(
        "--mix",
        action="store_true",
        help="show runs on different data or under different protocols beside each other",
    )
    add_output(parser, "FOLDER", "where to write (tables in the first PATH)", required=False)
    parser.runs("deepring.cli.tables_command:tables_command")


def add_report(parser: Parser) -> None:
    """``deepring report RUN``."""
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of an evaluated run")
    add_output(parser, "FILE", "the new page (RUN/report.html)", required=False)
    parser.add_argument(
        "--failures", type=whole(0), default=6, metavar="N", help="how many are drawn (%(default)s)"
    )
    parser.runs("deepring.cli.report_command:report_command")


def _add_over(parser: Parser) -> None:
    parser.add_argument(
        "--over",
        default="answerable",
        help="the queries that recall is a share of: answerable or all (%(default)s)",
    )


def _radii(text: str) -> list[float]:
    """Different lengths in metres, split at commas."""
    try:
        radii = [number(0)(part) for part in text.split(",")]
    except argparse.ArgumentTypeError:
        radii = []
    if not radii or len(set(radii)) < len(radii) or min(radii) <= 0:
        raise argparse.ArgumentTypeError(
            f"{text!r}, expected different lengths in metres, such as 10,5,25"
        )
    return radii
