"""`deepring loops`: loop closures of a drive, for a pose-graph back end."""

import argparse
from pathlib import Path

from deepring.cli.console import console
from deepring.cli.notices import warn
from deepring.cli.options import expect_new, network_of, open_drive
from deepring.data.left_out import LeftOut
from deepring.io.files import cut_short, write_together
from deepring.localization.graph_files import g2o_lines, json_text, tum_lines
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.loops import LoopSettings, find_loops
from deepring.localization.map import Map
from deepring.localization.refinement import RefinementSettings
from deepring.progress import progress_bar


def loops_command(args: argparse.Namespace) -> None:
    """Write OUT.g2o, OUT.tum and OUT.json."""
    files = {ending: Path(f"{args.output}.{ending}") for ending in ("g2o", "tum", "json")}
    if not cut_short(files.values()):
        for path in files.values():
            expect_new(path)
    refinement = RefinementSettings() if args.refine else None
    settings = LoopSettings(args.spacing, args.recent, refinement)
    network = network_of(args.checkpoint)
    session, ground_z = open_drive(args)
    empty = Map(network, ground_z, thresholds=AcceptanceThresholds(args.fit, args.ratio))
    left_out = LeftOut()
    with progress_bar(f"{session.name}: looking back") as bar:
        graph = find_loops(session, empty, settings, bar, left_out)
    warn(str(left_out))
    write_together(
        {
            files["g2o"]: "\n".join(g2o_lines(graph)) + "\n",
            files["tum"]: "\n".join(tum_lines(graph)) + "\n",
            files["json"]: json_text(graph) + "\n",
        }
    )
    console.print(f"keyframes    {len(graph.scans)}")
    console.print(f"loops        {len(graph.loops)}")
    if args.refine:
        console.print(f"refined      {sum(loop.refined for loop in graph.loops)}")
    for path in files.values():
        console.print(f"written      {path}")
