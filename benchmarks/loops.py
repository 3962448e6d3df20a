"""Loop closures of drives beside their poses: precision and recall.

    python benchmarks/loops.py kitti=FOLDER sim_nclt=outputs/datasets/sim_nclt_seed0 [--fit 0.3]
    python benchmarks/loops.py --keep 0.98 sim_nclt=FOLDER sim_mulran=FOLDER ...

A loop is right where it agrees with the drive's poses to 2 m and 5°, and to 4 m and 5° beside it,
since poses drift too. Recall is over the keyframes that came within 10 m of one that was driven at
least 50 m before. A dataset of several sessions gives its first. ``--keep`` asks in addition for
the largest fit that keeps that share of all these drives' returns.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from deepring.cli.process import tune_process
from deepring.core.rigid import yaw_of
from deepring.data.readers import ground_of, list_sessions, open_session
from deepring.data.spacing import path_lengths
from deepring.localization.calibration import (
    FITS,
    LocalizationTrials,
    Tolerance,
    concatenate,
    evaluate_thresholds,
)
from deepring.localization.drives.loops import LOOP_THRESHOLDS, LoopGraph, LoopSettings, find_loops
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import load_network

NEAR = 10.0
RIGHT, BESIDE = Tolerance(2.0, 5.0, NEAR), Tolerance(4.0, 5.0, NEAR)


class Drive(NamedTuple):
    """Every keyframe of a drive looked up, whether trusted or not."""

    name: str
    keyframes: int
    trials: LocalizationTrials
    seconds: float
    """A keyframe."""


def look_back(name: str, root: str, network: DeepRing, settings: LoopSettings) -> Drive:
    """Each keyframe's best loop beside the poses, the first session's."""
    format = name.removeprefix("sim_")
    session = open_session(format, root, list_sessions(format, root)[0])
    started = time.perf_counter()
    accepting = AcceptanceThresholds(fit=-np.inf, ratio=0.0)
    place_map = Map(network, ground_of(session, format), thresholds=accepting)
    graph = find_loops(session, place_map, settings)
    seconds = (time.perf_counter() - started) / len(graph.scans)
    path = path_lengths(session.positions)[graph.scans]
    trials = trials_of(graph, path, settings.recent)
    return Drive(Path(root).name, len(graph.scans), trials, seconds)


def trials_of(graph: LoopGraph, path: np.ndarray, recent: float) -> LocalizationTrials:
    """Loops beside what the poses say; the distance to the nearest keyframe of the past."""
    rows, positions = [], graph.poses[:, :2, 3]
    for loop in graph.loops:
        relative = np.linalg.inv(graph.poses[loop.earlier]) @ graph.poses[loop.keyframe]
        turn = float(yaw_of(relative)) - loop.yaw
        past = int(np.searchsorted(path, path[loop.keyframe] - recent))
        away = np.linalg.norm(positions[:past] - positions[loop.keyframe], axis=1)
        off = np.hypot(relative[0, 3] - loop.x, relative[1, 3] - loop.y)
        degrees = abs(np.degrees((turn + np.pi) % (2 * np.pi) - np.pi))
        rows.append((loop.fit, loop.ratio, off, degrees, away.min(), np.inf))
    return LocalizationTrials(*np.array(rows, dtype=np.float64).reshape(-1, 6).T)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="DATA=FOLDER")
    parser.add_argument("--checkpoint", default="shipped")
    parser.add_argument("--fit", type=float, default=LOOP_THRESHOLDS.fit)
    parser.add_argument("--ratio", type=float, default=LOOP_THRESHOLDS.ratio)
    parser.add_argument("--keep", type=float, metavar="SHARE", help="choose a fit by its recall")
    args = parser.parse_args()
    torch.set_num_threads(1)
    tune_process()
    network, drives = load_network(args.checkpoint).method, []
    print("| | keyframes | loops | right to 2 m | to 4 m | recall | of | ms |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for item in args.data:
        drive = look_back(*item.split("=", 1), network, LoopSettings())
        drives.append(drive)
        thresholds = AcceptanceThresholds(args.fit, args.ratio)
        strict, wide = (
            evaluate_thresholds(drive.trials, thresholds, tolerance)
            for tolerance in (RIGHT, BESIDE)
        )
        print(
            f"| {drive.name} | {drive.keyframes} | {strict.trusted} | {strict.precision:.3f} | "
            f"{wide.precision:.3f} | {wide.recall:.3f} | {(drive.trials.nearest <= NEAR).sum()} | "
            f"{drive.seconds * 1e3:.0f} |",
            flush=True,
        )
    if args.keep is not None:
        trials = concatenate([drive.trials for drive in drives])
        by_fit = [
            evaluate_thresholds(trials, AcceptanceThresholds(float(fit), args.ratio), RIGHT)
            for fit in FITS
        ]
        sufficient = [one for one in by_fit if one.recall >= args.keep]
        if not sufficient:
            raise SystemExit(f"--keep {args.keep}: at most {by_fit[0].recall:.3f} are found at all")
        best = sufficient[-1]
        print(
            f"\nfit {best.thresholds.fit:g} keeps {best.recall:.3f} of the returns at a "
            f"precision of {best.precision:.3f} ({best.trusted} loops)"
        )


if __name__ == "__main__":
    main()
