"""`deepring loops`: the trajectory of a drive and its loop closures."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from rich.table import Table

from deepring.cli.console import console
from deepring.cli.drive_source import DriveSource, open_source
from deepring.cli.json_output import print_as
from deepring.cli.looking import expect_lookable, show_scene
from deepring.cli.notices import warn
from deepring.cli.options import expect_new, network_of
from deepring.data.inspection.trajectory import expect_drive
from deepring.data.left_out import LeftOut
from deepring.data.poses.trajectory import Trajectory
from deepring.data.poses.tum import read_tum
from deepring.data.recording import Recording
from deepring.io.files import cut_short, write_together
from deepring.localization.drives.drive_result import (
    DriveResult,
    Truth,
    result_json,
    result_values,
    truth_at,
)
from deepring.localization.drives.graph_files import g2o_lines, loop_lines
from deepring.localization.drives.loop_graph import LoopGraph, Track, track_of
from deepring.localization.drives.loops import LoopSettings, find_loops
from deepring.localization.drives.odometry import kiss_icp
from deepring.localization.drives.odometry_loops import find_loops_by_odometry
from deepring.localization.drives.pose_graph import gtsam, optimize
from deepring.localization.drives.trajectory_files import kitti_lines, tum_lines
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.localization.registration.refinement import RefinementSettings, small_gicp
from deepring.progress import progress_bar
from deepring.reports.drive_figure import drive_figure
from deepring.reports.drive_page import drive_page, error_head, error_rows, summary_rows
from deepring.reports.drive_scene import drive_scene
from deepring.reports.style import png
from deepring.text import printable


def loops_command(args: argparse.Namespace) -> None:
    """Find loops, and write trajectories, graph, picture and page."""
    files = _files(args)
    if not cut_short(files.values()):
        for path in files.values():
            expect_new(path)
    expect_lookable(args, *files.values())
    if args.optimize:
        gtsam()  # what is missing is said before the drive is read
        small_gicp()
    refinement = RefinementSettings() if args.refine or args.optimize else None
    settings = LoopSettings(args.spacing, args.recent, refinement)
    truth = None if args.poses is None else _true_poses(args.poses)
    network = network_of(args.checkpoint)
    source = open_source(args)
    if isinstance(source.scans, Recording):
        kiss_icp()
    thresholds = AcceptanceThresholds(args.fit, args.ratio)
    track, graph = _look_back(
        source, Map(network, source.ground_z, thresholds=thresholds), settings
    )
    for doubt in track.doubts:
        warn(f"session {track.name}: {doubt}")
    result = DriveResult(
        track,
        graph,
        source.ground_z,
        optimize(graph) if args.optimize else None,
        _truth(source, track, truth),
    )
    write_together(_contents(result, files))
    written = list(files.values())
    content = {**result_values(result), "written": written}
    print_as(args, "loops", lambda: content, lambda: _say(result, written))
    show_scene(args, lambda: drive_scene(result))


def _true_poses(file: Path) -> Trajectory:
    """The poses of --poses; warns of steps that no drive has."""
    truth = read_tum(file)
    for finding in expect_drive(file, truth, any_world=True):
        warn(f"{file}: {finding}")
    return truth


def _files(args: argparse.Namespace) -> dict[str, Path]:
    """The files to write, by what they hold."""
    names = {"json": ".json", "g2o": ".g2o", "loops": ".loops.txt"}
    for trajectory in ("odometry", "optimized") if args.optimize else ("odometry",):
        names |= {f"{trajectory} {form}": f"_{trajectory}.{form}" for form in ("tum", "kitti")}
    names |= {"picture": ".png", "page": ".html"}
    return {what: Path(f"{args.output}{ending}") for what, ending in names.items()}


def _look_back(source: DriveSource, empty: Map, settings: LoopSettings) -> tuple[Track, LoopGraph]:
    """Poses and loops; warns of scans that are left out."""
    scans, left_out = source.scans, LeftOut()
    if isinstance(scans, Recording):
        with progress_bar(f"{scans.name}: odometry and looking back") as bar:
            track, graph = find_loops_by_odometry(scans, empty, settings, None, bar, left_out)
    else:
        with progress_bar(f"{scans.name}: looking back") as bar:
            graph = find_loops(scans, empty, settings, bar, left_out)
        track = track_of(scans)
    warn(str(left_out))
    return track, graph


def _truth(source: DriveSource, track: Track, given: Trajectory | None) -> Truth | None:
    """The true poses, of --poses or of the drive itself where it is gone through by odometry."""
    if given is not None:
        return truth_at(track, given)
    if source.own_poses is None:
        return None
    return Truth.whole(source.own_poses[track.scans])


def _contents(result: DriveResult, files: dict[str, Path]) -> dict[Path, str | bytes]:
    """What each file holds."""
    contents: dict[str, str | bytes] = {
        "json": result_json(result) + "\n",
        "g2o": _text(g2o_lines(result.graph, result.kept)),
        "loops": _text(loop_lines(result.kept)),
        "picture": png(drive_figure(result)),
        "page": drive_page(result),
    }
    for name, poses in result.trajectories().items():
        contents[f"{name} tum"] = _text(tum_lines(poses, result.track.stamps))
        contents[f"{name} kitti"] = _text(kitti_lines(poses))
    return {path: contents[what] for what, path in files.items()}


def _text(lines: Iterable[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


def _say(result: DriveResult, written: Iterable[Path]) -> None:
    for name, value in summary_rows(result):
        console.print(f"{name:<13}{value}")
    errors = result.errors()
    if errors:
        table = Table(box=None, header_style="bold")
        for name in error_head(errors):
            table.add_column(name, justify="right" if name else "left", overflow="fold")
        for row in error_rows(errors):
            table.add_row(*row)
        console.print(table)
    for path in written:
        console.print(f"written      {printable(str(path))}")
