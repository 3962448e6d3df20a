"""Trajectories beside true poses: odometry, a simulated drift, and what loops make of both.

    python benchmarks/trajectory.py sim_nclt=FOLDER kitti=FOLDER ... [--odometry] [--spacing 4]

Without ``--odometry`` the true motion of each drive is given a drift, that of the steps between
all scans: a bias of 1 % in scale and 0.01° a metre in yaw and pitch, and noise of 2 cm and 0.05° a
step (seed 0). With it the poses are KISS-ICP's. Loops are found along these poses by `find_loops`
or in the same pass, refined, and closed in the pose graph. A loop is right to 1 m and 3° of the
true poses. A dataset of several sessions gives its first. The last columns say how far an edge of
the odometry is off along each axis, per root of its length in metres, and what is left of the ATE
after an alignment with scale.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from deepring.cli.process import tune_process
from deepring.core.rigid import pose_from
from deepring.data.readers import ground_of, list_sessions, open_session
from deepring.data.recording import recorded_session
from deepring.localization.drives.drive_result import DriveResult, Truth
from deepring.localization.drives.loop_graph import track_of
from deepring.localization.drives.loops import LOOP_THRESHOLDS, LoopSettings, find_loops
from deepring.localization.drives.odometry_loops import find_loops_by_odometry
from deepring.localization.drives.pose_graph import optimize
from deepring.localization.map import Map
from deepring.localization.registration.refinement import RefinementSettings
from deepring.methods.network_file import load_network

SCALE, TURN, NOISE, WOBBLE = 0.01, np.radians(0.01), 0.02, np.radians(0.05)


def drifted(truth: np.ndarray, seed: int = 0) -> np.ndarray:
    """The true poses (n, 4, 4), whose motion drifts."""
    rng, poses = np.random.default_rng(seed), [truth[0]]
    for k in range(len(truth) - 1):
        step = np.linalg.inv(truth[k]) @ truth[k + 1]
        length = np.linalg.norm(step[:3, 3])
        turn = rng.normal(0, WOBBLE, 3) + length * TURN * np.array([0, 1, 1])
        off = pose_from(Rotation.from_rotvec(turn).as_matrix(), rng.normal(0, NOISE, 3))
        step[:3, 3] *= 1 + SCALE
        poses.append(poses[-1] @ step @ off)
    return np.stack(poses)


def result_of(name: str, root: str, args: argparse.Namespace) -> DriveResult:
    format = name.removeprefix("sim_")
    session = open_session(format, root, list_sessions(format, root)[0])
    ground_z = ground_of(session, format)
    network = load_network("shipped").method
    empty = Map(network, ground_z, thresholds=LOOP_THRESHOLDS)
    settings = LoopSettings(args.spacing, refinement=RefinementSettings())
    if args.odometry:
        track, graph = find_loops_by_odometry(recorded_session(session), empty, settings)
    else:
        session = replace(session, poses=drifted(session.poses))
        track, graph = track_of(session), find_loops(session, empty, settings)
        session = open_session(format, root, session.name)
    truth = Truth.whole(session.poses[track.scans])
    return DriveResult(track, graph, ground_z, optimize(graph), truth)


def right(result: DriveResult) -> np.ndarray:
    """Which loops are right (loops,)."""
    assert result.truth is not None
    true = result.truth.poses[result.graph.scans]
    found = []
    for loop in result.graph.loops:
        expected = np.linalg.inv(true[loop.earlier]) @ true[loop.keyframe]
        off = np.linalg.inv(expected) @ loop.transform
        turn = np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude())
        found.append(np.linalg.norm(off[:3, 3]) < 1 and turn < 3)
    return np.array(found, dtype=bool)


def edge_errors(result: DriveResult) -> tuple[float, float]:
    """Deviations along an axis of the odometry's edges, metres and degrees, per root of a metre."""
    assert result.truth is not None
    poses, true = result.graph.poses, result.truth.poses[result.graph.scans]
    off = np.linalg.inv(motions(true)) @ motions(poses)
    root = np.sqrt(np.maximum(1.0, np.linalg.norm(motions(true)[:, :3, 3], axis=1)))[:, None]
    whole = np.delete(np.arange(len(off)), [k - 1 for k in result.graph.breaks])
    turns = Rotation.from_matrix(off[:, :3, :3]).as_rotvec(degrees=True)
    deviations = [np.sqrt(((v / root)[whole] ** 2).mean()) for v in (off[:, :3, 3], turns)]
    return float(deviations[0]), float(deviations[1])


def motions(poses: np.ndarray) -> np.ndarray:
    """From each pose (n, 4, 4) to the next."""
    return np.linalg.inv(poses[:-1]) @ poses[1:]


def scaled_error(poses: np.ndarray, true: np.ndarray) -> float:
    """ATE after the best alignment with scale, metres."""
    here, there = (p[:, :3, 3] - p[:, :3, 3].mean(axis=0) for p in (poses, true))
    turn, _ = Rotation.align_vectors(there, here)
    turned = turn.apply(here)
    scale = (turned * there).sum() / (turned**2).sum()
    return float(np.sqrt(((scale * turned - there) ** 2).sum(axis=1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="DATA=FOLDER")
    parser.add_argument("--odometry", action="store_true", help="by KISS-ICP, not simulated drift")
    parser.add_argument("--spacing", type=float, default=2.0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    tune_process()
    print("| | scans | breaks | loops (right) | rejected (right) | ATE before | after | factor "
          "| RPE 100 m before | after | edge m | edge ° | with scale | s |")  # fmt: skip
    print("| --- |" + " ---: |" * 13)
    for item in args.data:
        started = time.process_time()
        result = result_of(*item.split("=", 1), args)
        assert result.optimized is not None
        good, accepted = right(result), result.optimized.accepted
        errors = result.errors()
        before, after = errors["odometry"], errors["optimized"]
        metres, degrees = edge_errors(result)
        assert result.truth is not None
        trajectory = result.trajectories()["optimized"]
        scaled = scaled_error(trajectory, result.truth.poses)
        print(
            f"| {Path(item).name} | {len(result.track.scans)} | {len(result.graph.breaks)} | "
            f"{len(good)} ({good.sum()}) | {(~accepted).sum()} ({(good & ~accepted).sum()}) | "
            f"{before.absolute.rmse:.2f} m | {after.absolute.rmse:.2f} m | "
            f"{before.absolute.rmse / after.absolute.rmse:.1f} | "
            f"{before.relative[-1].shift:.2f} m | {after.relative[-1].shift:.2f} m | "
            f"{metres:.3f} | {degrees:.3f} | {scaled:.2f} m | "
            f"{time.process_time() - started:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
