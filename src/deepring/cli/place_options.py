"""Options of the commands about places: map, localize, loops and export."""

from pathlib import Path

from deepring.cli.options import (
    add_drive,
    add_ground,
    add_method,
    add_metres,
    add_network,
    add_output,
    add_session,
)
from deepring.cli.parser import Names, Parser, number, subcommands, whole

BINARY_FORMATS = "deepring.data.readers:binary_formats"

#: Formats that `localize` prints.
FORMS = ("table", "json", "csv")


def add_map(parser: Parser) -> None:
    """``deepring map build | info | calibrate``."""
    add = subcommands(parser)
    _add_build(add("build", help="build a map of one drive", description="Build a map of a drive."))
    shower = add("info", help="show what a map holds", description="Show what a map holds, after "
                 "checking every byte of it.")  # fmt: skip
    shower.add_argument("map", type=Path, metavar="MAP")
    shower.runs("deepring.cli.map_command:info")
    _add_calibrate(
        add(
            "calibrate",
            help="set when to trust a map",
            description="Set the thresholds of trust by a second drive in the map's world.",
        )
    )


def _add_build(parser: Parser) -> None:
    add_drive(parser)
    add_network(parser)
    add_output(parser, "MAP", "the new map")
    add_metres(parser, "--spacing", 10.0, "metres between places")
    parser.add_argument(
        "--precision",
        default="int8",
        help="of the descriptors: float32, bfloat16 or int8 (%(default)s)",
    )
    parser.runs("deepring.cli.map_command:build")


def _add_calibrate(parser: Parser) -> None:
    parser.add_argument("map", type=Path, metavar="MAP")
    add_drive(parser)
    add_output(parser, "MAP", "the new map")
    parser.add_argument(
        "--precision",
        type=number(0),
        default=0.99,
        metavar="SHARE",
        help="share of the trusted locations that are right (%(default)g)",
    )
    add_metres(parser, "--within", 2.0, "metres to the truth within which a location is right")
    add_metres(parser, "--spacing", 5.0, "metres between scans")
    parser.runs("deepring.cli.map_command:calibrate_map", metres="--within")


def add_localize(parser: Parser) -> None:
    """``deepring localize MAP SCAN...``."""
    parser.add_argument("map", type=Path, metavar="MAP")
    parser.add_argument(
        "scans", type=Path, nargs="+", metavar="SCAN", help="files, folders, bags or a drive.yaml"
    )
    parser.add_argument(
        "--format", choices=Names(BINARY_FORMATS), metavar="NAME", help="of .bin files: %(choices)s"
    )
    parser.add_argument("--topic", help="of a bag's point clouds, where it has several")
    parser.add_argument(
        "--every",
        type=whole(1),
        default=1,
        metavar="N",
        help="take every N-th scan of a bag or a drive (%(default)s)",
    )
    add_session(parser, "which drive, where drive.yaml describes several")
    add_ground(parser, "the map's")
    parser.add_argument("--as", dest="form", choices=FORMS, default="table", help="(%(default)s)")
    parser.add_argument(
        "--unchecked", action="store_true", help="do not read the whole map to check it"
    )
    parser.runs("deepring.cli.localize_command:localize_command", binary="--format")


def add_loops(parser: Parser) -> None:
    """``deepring loops FOLDER -o OUT``."""
    add_drive(parser)
    add_network(parser)
    add_output(parser, "OUT", "path of the new files, without their endings")
    add_metres(parser, "--spacing", 2.0, "metres between keyframes")
    add_metres(parser, "--recent", 50.0, "metres of path that a loop is longer than")
    parser.add_argument(
        "--fit", type=number(0), default=0.32, help="least fit that is trusted (%(default)g)"
    )
    parser.add_argument(
        "--ratio",
        type=number(0),
        default=1.41,
        help="least ratio to a contradicting fit that is trusted (%(default)g)",
    )
    parser.add_argument(
        "--refine",
        action="store_true",
        help="refine each loop on the points of its two scans (needs deepring[refine])",
    )
    parser.runs("deepring.cli.loops_command:loops_command")


def add_export(parser: Parser) -> None:
    """``deepring export CHECKPOINT -o FILE``."""
    parser.add_argument("checkpoint", metavar="CHECKPOINT", help="a .ckpt, or 'shipped'")
    add_method(parser)
    add_output(parser, "FILE", "the new file, .onnx or .safetensors")
    parser.runs("deepring.cli.export_command:export_command", own_class="--method")
