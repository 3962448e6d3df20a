"""Loop closures of one drive beside its poses: precision and recall.

    python benchmarks/loops.py kitti=FOLDER sim_nclt=outputs/datasets/sim_nclt_seed0 [--fit 0.2]

A loop is right where it agrees with the drive's poses to 2 m and 5°, and to 4 m and 5° beside it,
since poses drift too. Recall is over the keyframes that came within 10 m of one that was driven at
least 50 m before. A dataset of several sessions gives its first.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from deepring.core.rigid import yaw_of
from deepring.data.formats import FORMATS, list_sessions, open_session
from deepring.data.sampling import path_lengths
from deepring.maps.loops import LoopGraph, LoopSettings, find_loops
from deepring.maps.map import Map, Trust
from deepring.training.module import load_network

NEAR = 10.0


def disagreement(graph: LoopGraph) -> np.ndarray:
    """Metres and degrees (n, 2) from what the poses say."""
    rows = []
    for loop in graph.loops:
        relative = np.linalg.inv(graph.poses[loop.earlier]) @ graph.poses[loop.keyframe]
        turn = float(yaw_of(relative)) - loop.yaw
        off = np.hypot(relative[0, 3] - loop.x, relative[1, 3] - loop.y)
        rows.append((off, abs(np.degrees((turn + np.pi) % (2 * np.pi) - np.pi))))
    return np.array(rows).reshape(-1, 2)


def returning(graph: LoopGraph, path: np.ndarray, recent: float) -> np.ndarray:
    """Numbers of the keyframes that came back to where an earlier one was."""
    positions = graph.poses[:, :2, 3]
    found = []
    for k in range(len(path)):
        past = int(np.searchsorted(path, path[k] - recent))
        away = np.linalg.norm(positions[:past] - positions[k], axis=1)
        if past and away.min() < NEAR:
            found.append(k)
    return np.array(found)


def main() -> None:
    usual = Trust()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", metavar="DATA=FOLDER")
    parser.add_argument("--checkpoint", default="shipped")
    parser.add_argument("--fit", type=float, default=usual.fit)
    parser.add_argument("--ratio", type=float, default=usual.ratio)
    args = parser.parse_args()
    torch.set_num_threads(1)
    network, settings = load_network(args.checkpoint).method, LoopSettings()
    print("| | keyframes | loops | right to 2 m | to 4 m | recall | of | ms |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for item in args.data:
        name, _, root = item.partition("=")
        format = name.removeprefix("sim_")
        session = open_session(format, root, list_sessions(format, root)[0])
        empty = Map(network, FORMATS[format].ground_z, trust=Trust(args.fit, args.ratio))
        started = time.perf_counter()
        graph = find_loops(session, empty, settings)
        seconds = (time.perf_counter() - started) / len(graph.scans)
        off = disagreement(graph)
        right = [(off[:, 0] < metres) & (off[:, 1] < 5) for metres in (2, 4)]
        path = path_lengths(session.positions)[graph.scans]
        back = returning(graph, path, settings.recent)
        found = {loop.keyframe for loop, good in zip(graph.loops, right[1], strict=True) if good}
        recall = np.mean([k in found for k in back]) if len(back) else np.nan
        print(
            f"| {Path(root).name} | {len(graph.scans)} | {len(off)} | {right[0].mean():.3f} | "
            f"{right[1].mean():.3f} | {recall:.3f} | {len(back)} | {seconds * 1e3:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
