"""Options of the commands about places: map, localize, loops and export."""

from pathlib import Path

from deepring.cli.options import (
    add_drive,
    add_form,
    add_format,
    add_ground,
    add_looking,
    add_method,
    add_metres,
    add_network,
    add_output,
    add_session,
)
from deepring.cli.parser import Names, Parser, number, subcommands, whole

DRIVE_FORMATS = "deepring.data.readers:drive_formats"
BINARY_FORMATS = "deepring.data.readers:binary_formats"

#: Output formats of `localize`, beside a table and JSON: an object a line, and CSV.
FORMS = ("jsonl", "csv")


def add_map(parser: Parser) -> None:
    """``deepring map build | info | calibrate | merge``."""
    add = subcommands(parser)
    _add_build(
        add(
            "build",
            help="build a map of drives, or of a point cloud",
            description="Build a map of one or several drives, or of a point cloud.",
        )
    )
    shower = add("info", help="show what a map holds", description="Show what a map holds, after "
                 "checking every byte of it.")  # fmt: skip
    shower.add_argument("map", type=Path, metavar="MAP")
    add_looking(shower)
    add_form(shower, "text")
    shower.runs("deepring.cli.map_command:info")
    _add_calibrate(
        add(
            "calibrate",
            help="calibrate when to trust a map",
            description="Set the thresholds of trust with a second drive in the map's world.",
        )
    )
    _add_merge(
        add(
            "merge",
            help="put two maps together",
            description="Find where map B lies in map A by locating its places there, and write a "
            "map of both, in the frame of A and with its network and thresholds.",
        )
    )


def _add_build(parser: Parser) -> None:
    parser.add_argument(
        "roots",
        type=Path,
        nargs="+",
        metavar="DATA",
        help="folders of datasets, drive.yaml files and bags of one world, or a point cloud: .pcd, "
        ".ply, .las, .laz, a folder of tiles",
    )
    add_format(parser)
    parser.add_argument(
        "--session",
        action="append",
        help="session, if the folder holds several; may be given again for further ones",
    )
    parser.flags["name"] = "--session"
    add_ground(parser, "the drive's, or where a bag's first scans show it,")
    parser.add_argument(
        "--poses",
        type=Path,
        action="append",
        metavar="FILE",
        help="of a bag or a folder of scans: poses by stamps, TUM; once for each, in their order",
    )
    _add_topic(parser)
    add_network(parser)
    add_output(parser, "MAP", "the new map")
    parser.add_argument(
        "--spacing",
        type=number(0, "metres"),
        metavar="M",
        help="metres between places (10; 5 in a point cloud without --path)",
    )
    _add_cloud(parser)
    parser.add_argument(
        "--precision",
        default="int8",
        help="type of the descriptors: float32, bfloat16 or int8 (%(default)s)",
    )
    parser.add_argument(
        "--points",
        action="store_true",
        help="keep the places' points, thinned, for `localize --refine`; the map becomes larger",
    )
    add_looking(parser)
    add_form(parser, "text")
    parser.runs("deepring.cli.map_build_command:build", poses="--poses")


def _add_cloud(parser: Parser) -> None:
    parser.add_argument(
        "--path",
        type=Path,
        metavar="FILE",
        help="of a point cloud: poses that were driven, TUM or KITTI; places are put along them",
    )
    parser.add_argument(
        "--height",
        type=number(0.1, "metres"),
        metavar="M",
        help="of a point cloud: metres of the localising sensor above the ground (1.73)",
    )
    parser.add_argument(
        "--fov",
        type=number(unit="degrees"),
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="of a point cloud: elevations that the sensor sees, degrees (-25 20)",
    )


def _add_calibrate(parser: Parser) -> None:
    parser.add_argument("map", type=Path, metavar="MAP")
    add_drive(parser)
    add_output(parser, "MAP", "the new map")
    parser.add_argument(
        "--precision",
        type=number(0),
        default=0.99,
        metavar="SHARE",
        help="required share of right locations among the trusted (%(default)g)",
    )
    add_metres(parser, "--within", 2.0, "largest error of a right location, metres")
    add_metres(parser, "--spacing", 5.0, "metres between scans")
    add_form(parser, "text")
    parser.runs("deepring.cli.map_command:calibrate_map", metres="--within")


def _add_merge(parser: Parser) -> None:
    parser.add_argument("first", type=Path, metavar="A")
    parser.add_argument("second", type=Path, metavar="B")
    add_output(parser, "MAP", "the new map")
    add_form(parser, "text")
    parser.runs("deepring.cli.map_merge_command:merge", first="A", second="B")


def add_localize(parser: Parser) -> None:
    """``deepring localize MAP SCAN...``."""
    parser.add_argument("map", type=Path, metavar="MAP")
    parser.add_argument(
        "scans",
        type=Path,
        nargs="+",
        metavar="SCAN",
        help="files, folders, bags, datasets or a drive.yaml",
    )
    parser.add_argument(
        "--format",
        choices=Names(BINARY_FORMATS),
        metavar="NAME",
        help="format of .bin files: %(choices)s",
    )
    _add_topic(parser)
    _add_every(parser, "a folder, a bag or a drive")
    parser.add_argument(
        "--accumulate",
        type=whole(1),
        default=1,
        metavar="N",
        help="join each scan with up to N - 1 before it, for sensors that see little "
        "(%(default)s; needs deepring[odometry])",
    )
    add_session(parser, "drive, if a dataset or a drive.yaml has several")
    add_ground(parser, "the map's")
    add_form(parser, "table", FORMS)
    parser.add_argument(
        "--refine",
        action="store_true",
        help="give the whole pose, with its covariance, by the points of a map built with --points",
    )
    parser.add_argument(
        "--unchecked", action="store_true", help="do not check every byte of the map"
    )
    add_looking(parser)
    parser.runs(
        "deepring.cli.localize_command:localize_command",
        binary="--format",
        refinement="--refine",
        odometry="--accumulate",
    )


def add_loops(parser: Parser) -> None:
    """``deepring loops SCANS -o OUT``."""
    parser.add_argument(
        "root",
        type=Path,
        metavar="SCANS",
        help="a bag, a folder of scans in order, a dataset's folder, or a drive.yaml",
    )
    parser.add_argument(
        "--format",
        choices=Names(DRIVE_FORMATS),
        metavar="NAME",
        help="format of the dataset, recognised from the folder by default, or of .bin files: "
        "%(choices)s",
    )
    add_session(parser, "session, if the folder holds several")
    add_ground(parser, "the drive's, or where its first scans show it,")
    _add_recording(parser)
    add_network(parser)
    add_output(parser, "OUT", "path of the new files, without the ending")
    add_metres(parser, "--spacing", 2.0, "metres between keyframes")
    add_metres(parser, "--recent", 50.0, "shortest path of a loop, metres")
    parser.add_argument(
        "--fit", type=number(0), default=0.32, help="smallest fit that is trusted (%(default)g)"
    )
    parser.add_argument(
        "--ratio",
        type=number(0),
        default=1.41,
        help="smallest ratio to a contradicting fit that is trusted (%(default)g)",
    )
    parser.add_argument(
        "--refine",
        action="store_true",
        help="refine each loop on the points of its two scans (needs deepring[refine])",
    )
    parser.add_argument(
        "--optimize",
        action="store_true",
        help="close the refined loops in a pose graph (needs deepring[optimize])",
    )
    add_looking(parser, page=False)
    add_form(parser, "text")
    parser.runs(
        "deepring.cli.loops_command:loops_command", binary="--format", refinement="--refine"
    )


def _add_recording(parser: Parser) -> None:
    """The options of scans whose poses an odometry finds."""
    _add_topic(parser)
    _add_every(parser, "a drive without poses")
    parser.add_argument(
        "--odometry",
        action="store_true",
        help="find the poses by odometry although the drive has some, and compare (scans without "
        "poses need no flag; needs deepring[odometry])",
    )
    parser.add_argument(
        "--poses",
        type=Path,
        metavar="FILE",
        help="true poses to compare with, TUM's format, at the stamps of the scans",
    )


def _add_topic(parser: Parser) -> None:
    parser.add_argument("--topic", help="topic of the point clouds, if a bag has several")


def _add_every(parser: Parser, of: str) -> None:
    parser.add_argument(
        "--every",
        type=whole(1),
        default=1,
        metavar="N",
        help=f"take every N-th scan of {of} (%(default)s)",
    )


def add_export(parser: Parser) -> None:
    """``deepring export CHECKPOINT -o FILE``."""
    parser.add_argument("checkpoint", metavar="CHECKPOINT", help="a .ckpt, or 'shipped'")
    add_method(parser)
    add_output(parser, "FILE", "the new file, .onnx or .safetensors")
    add_form(parser, "text")
    parser.runs("deepring.cli.export_command:export_command", own_class="--method")
