"""Options of the commands about runs, from train to report."""

import argparse
from pathlib import Path
from textwrap import wrap

from deepring.cli.options import add_form, add_method, add_output
from deepring.cli.parser import Parser, number, whole

#: Revisit radii in metres that `score` counts at, the headline first.
RADII = "10,5,15,20,25"

#: Columns to which the options of a group are wrapped.
_WIDTH = 100

_HYDRA = """\
KEY=VALUE sets a value, such as data.root=FOLDER; GROUP=NAME chooses an option of a group, such
as method=ring; ~GROUP chooses none, test=[A,B] several. --cfg job prints the composed config,
--info config its sources.

groups and their options (* is the default):
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
    add_form(parser)
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    parser.runs(f"deepring.cli.train_commands:{name}_command")


def config_help(command: str) -> str:
    """The groups of ``conf/`` with their options and defaults, for the end of a help text."""
    from deepring.experiment.config_groups import chosen_options, config_folder, group_options

    folder = config_folder()
    defaults, options = chosen_options(folder, command), group_options(folder)
    # The groups below method can be chosen wherever method can.
    groups = [group for group in options if group.partition("/")[0] in defaults]
    width = max(map(len, groups)) + 2
    lines = []
    for group in groups:
        names = [f"{name}*" if name == defaults.get(group) else name for name in options[group]]
        first, *rest = wrap(" ".join(names), _WIDTH - width - 2, break_long_words=False)
        lines += [f"  {group:<{width}}{first}", *(f"  {'':<{width}}{line}" for line in rest)]
    return _HYDRA + "\n".join(lines)


def add_compare(parser: Parser) -> None:
    """``deepring compare [KEY=VALUE ...]``."""
    parser.add_argument(
        "--learned",
        metavar="METHODS",
        help="learned methods of conf/method, or all of them in their CPU sizes; four by default",
    )
    parser.add_argument(
        "--fixed",
        metavar="METHODS",
        help="methods that learn nothing, or all; RING, RING++ and both Scan Contexts by default",
    )
    parser.add_argument(
        "--train",
        metavar="DATASETS",
        help="datasets to train on, one after the other; two by default",
    )
    parser.add_argument("--test", metavar="DATASETS", help="datasets to test on; two by default")
    parser.add_argument("--seeds", metavar="SEEDS", help="seeds; 0,1 by default")
    add_form(parser)
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    parser.runs("deepring.cli.compare_command:compare_command")


def add_status(parser: Parser) -> None:
    """``deepring status PATH...``."""
    parser.add_argument(
        "paths",
        type=Path,
        nargs="+",
        metavar="PATH",
        help="folder of a sweep, of several, or of a run",
    )
    add_form(parser)
    parser.runs("deepring.cli.status_command:status_command")


def add_score(parser: Parser) -> None:
    """``deepring score FOLDER``."""
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="folder of a run, or of its descriptors"
    )
    parser.add_argument(
        "--radii",
        type=_radii,
        default=RADII,
        metavar="M,M,...",
        help="revisit radii in metres, the headline first (%(default)s)",
    )
    parser.add_argument(
        "--wrong-beyond",
        type=number(0, "metres"),
        metavar="M",
        help="metres beyond which a best place is wrong; nearer ones that are not right do not "
        "count for F1, AUC and AP (all that is not right is wrong)",
    )
    _add_over(parser)
    add_method(parser)
    add_output(parser, "FILE", "also write the results as CSV", required=False)
    add_form(parser)
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
    _add_mix(parser)
    add_output(parser, "FOLDER", "where to write (tables/ in the first PATH)", required=False)
    add_form(parser)
    parser.runs("deepring.cli.tables_command:tables_command")


def add_report(parser: Parser) -> None:
    """``deepring report FOLDER``."""
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="folder of an evaluated run, or of a sweep"
    )
    add_output(parser, "FILE", "the new page (FOLDER/report.html)", required=False)
    parser.add_argument(
        "--pictures",
        type=whole(0),
        default=120,
        metavar="N",
        help="queries of a run to show with their scans (%(default)s)",
    )
    parser.add_argument(
        "--radius",
        type=number(0, "metres"),
        metavar="M",
        help="metres (a run's first radius; 10 for a sweep)",
    )
    parser.add_argument("--over", help="queries that count for the recall: answerable or all")
    _add_mix(parser)
    add_form(parser, "text")
    parser.runs("deepring.cli.report_command:report_command")


def _add_mix(parser: Parser) -> None:
    parser.add_argument(
        "--mix",
        action="store_true",
        help="show runs with different data or protocols in the same table",
    )


def _add_over(parser: Parser) -> None:
    parser.add_argument(
        "--over",
        default="answerable",
        help="queries that count for the recall: answerable or all (%(default)s)",
    )


def _radii(text: str) -> list[float]:
    """The radii in metres of a list with commas."""
    try:
        radii = [number(0)(part) for part in text.split(",")]
    except argparse.ArgumentTypeError:
        radii = []
    if not radii or len(set(radii)) < len(radii) or min(radii) <= 0:
        raise argparse.ArgumentTypeError(
            f"{text!r}, expected different lengths in metres, such as 10,5,25"
        )
    return radii
