"""The tree of commands. Parsers import nothing heavy; the work is imported after parsing."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from deepring import __version__
from deepring.cli import dataset_options, help_options, place_options, run_options
from deepring.cli.parser import HydraParser, MixedParser, Parser, subcommands


class _Command(NamedTuple):
    """One command of ``deepring``."""

    add_options: Callable[[Parser], None]
    summary: str
    description: str = ""
    parser: type[Parser] = Parser
    epilog: Callable[[], str] | None = None
    """Called when the help is printed."""


COMMANDS = {
    "train": _Command(
        run_options.add_train,
        "train a method and evaluate it, or run a sweep (-m)",
        "Train a method and evaluate it. resume=CHECKPOINT goes on in that run's folder,\n"
        "start_from=CHECKPOINT begins a run with the weights of an earlier stage, stages=[A,B]\n"
        "trains several; -m runs a sweep, one job after the other, or as hydra/launcher= says.",
        HydraParser,
        partial(run_options.config_help, "train"),
    ),
    "evaluate": _Command(
        run_options.add_evaluate,
        "evaluate methods on a test region",
        "Evaluate the network of checkpoint=FILE, and the methods that learn nothing.",
        HydraParser,
        partial(run_options.config_help, "evaluate"),
    ),
    "compare": _Command(
        run_options.add_compare,
        "train and evaluate all methods",
        "Train each method on each training dataset, evaluate all methods on all test datasets, "
        "print the paper's Tables I and II, and write them and a page. Finished runs are skipped, "
        "interrupted ones go on.",
        MixedParser,
        lambda: (
            "Lists are separated by commas, without spaces. KEY=VALUE are further Hydra overrides, "
            "such as hydra/launcher=joblib or test_data.kitti.root=FOLDER."
        ),
    ),
    "status": _Command(
        run_options.add_status,
        "say how far a sweep is",
        "Say which jobs of a sweep are done, running, failed or waiting, and about how long it "
        "still takes, while it runs or afterwards. Exits with 1 if a job failed, was killed, or "
        "gives no sign of life.",
    ),
    "score": _Command(
        run_options.add_score,
        "score exported descriptors again",
        "Look exported descriptors up again and print the rates, without scans and weights.",
    ),
    "tables": _Command(
        run_options.add_tables,
        "print the tables of finished runs",
        "Print the tables of finished runs, beside the paper's values, and write them as "
        "Markdown, LaTeX, CSV and a figure. Runs that differ in nothing but the seed are one row. "
        "Runs of several methods, or tested in several places, are compared (Tables I and II); "
        "any others are an ablation of DeepRING (Tables III and IV), without the methods that each "
        "was evaluated beside.",
    ),
    "case-study": _Command(
        dataset_options.add_case_study,
        "compare sinograms (SG) with polar grams (PG)",
        "Move scans by known rotations and translations, and compare how much the DFT magnitudes "
        "of sinograms (SG), of polar grams (PG) and of range images (RI) change; with --methods, "
        "how much the scores of methods do.",
    ),
    "properties": _Command(
        dataset_options.add_properties,
        "measure what methods bear, tell and cost",
        "Move scans by known turns and shifts, and measure for each method what these cost, what "
        "it tells of turn and pose, the size of its descriptors, its parameters and its time. "
        "Written are tables as Markdown and LaTeX, and all numbers as CSV.",
    ),
    "map": _Command(
        place_options.add_map,
        "build, show or calibrate a map",
        "Build a map of a drive, show what a map holds, or calibrate when to trust it.",
    ),
    "localize": _Command(
        place_options.add_localize,
        "locate scans in a map",
        "Locate scans in a map: position and heading in the world of its poses, and "
        "whether to trust them. Exits with 1 where a scan cannot be located.",
    ),
    "loops": _Command(
        place_options.add_loops,
        "find the trajectory and the loop closures of a drive",
        "Look each keyframe of a drive up among the earlier ones, and write the trusted loop "
        "closures. Without poses, as of a bag, an odometry finds them first; --optimize closes the "
        "loops. Written are OUT.json, OUT.g2o, OUT.loops.txt, trajectories before and after "
        "(OUT_odometry and OUT_optimized, .tum and .kitti), OUT.png and OUT.html.",
    ),
    "report": _Command(
        run_options.add_report,
        "write a run or a sweep as one HTML page",
        "Write a run as one page: what it found, methods side by side with intervals, curves, "
        "and a map on which one chooses a query and sees its scans and how they were compared. "
        "Of a sweep or a comparison: the best, curves, paired tests and tables of all finished "
        "runs. "
        "The page needs no network and no server.",
    ),
    "export": _Command(
        place_options.add_export,
        "write a trained network as one file",
        "Write a trained DeepRING as .onnx: occupancy from above (batch, n, n) float32 in, "
        "descriptors (batch, θ, ω) out; or any trained network as .safetensors, which all commands "
        "take as a checkpoint. The file's metadata states how it was made.",
    ),
    "simulate": _Command(
        dataset_options.add_simulate,
        "write a simulated dataset",
        "Write two sessions over one simulated world in the native layout of a dataset. An "
        "interrupted run goes on when started again; a finished one is left as it is.",
        MixedParser,
        dataset_options.knobs_help,
    ),
    "data": _Command(
        dataset_options.add_data,
        "check a dataset before using it",
        "Check a dataset before using it.",
    ),
    "doctor": _Command(
        help_options.add_doctor,
        "say what is installed, what fails, and what is slow",
        "Print versions, threads, GPU, folders, and measured times, to paste into a bug report. "
        "Exits with 1 if something makes commands fail.",
    ),
    "schema": _Command(
        help_options.add_schema,
        "print the JSON schema of an output, or of drive.yaml",
        "Print a JSON Schema: of what commands print with --as json, or of drive.yaml "
        "(drive_file).",
    ),
    "completion": _Command(
        help_options.add_completion,
        "print a script that lets a shell complete commands",
        "Print a script that lets bash, zsh or tcsh complete commands, options, files and config "
        "groups. It needs nothing but the shell.",
    ),
}


def command_line(name: str | None = None) -> Parser:
    """The parser of ``deepring``, with the options of all commands.

    The end of a help text that needs files or packages is made only for the command ``name``.
    """
    parser = Parser(
        "deepring",
        description="LiDAR place recognition with DeepRING and the methods beside it.",
        epilog="deepring COMMAND --help shows the options of a command.",
    )
    parser.add_argument("--version", action="version", version=f"deepring {__version__}")
    add = subcommands(parser)
    for key, command in COMMANDS.items():
        leaf = add(key, help=command.summary, description=command.description, kind=command.parser)
        command.add_options(leaf)
        if key == name and command.epilog is not None:
            leaf.epilog = command.epilog()
    return parser
