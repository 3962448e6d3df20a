"""A drive with loops, a break of the odometry, and what an optimisation made of it."""

import numpy as np

from deepring.core.rigid import pose_from
from deepring.localization.drives.drive_result import DriveResult, Truth
from deepring.localization.drives.loop_graph import Loop, LoopGraph, Track
from deepring.localization.drives.pose_graph import Optimized

N = 30


def result(optimized=True, truth=True):
    places = np.column_stack([np.arange(N), np.zeros(N), np.zeros(N)])
    poses = pose_from(np.tile(np.eye(3), (N, 1, 1)), places)
    names = [f"<scan {k}>.npy" for k in range(N)]
    doubts = ("the odometry was lost & found",)
    track = Track("a $b$ <drive>", np.arange(N), names, poses, None, True, 0, doubts)
    rows = np.arange(0, N, 3)
    loops = [
        Loop(8, 0, np.eye(4), 0.5, 2.0, 0.9, refined=True),
        Loop(9, 1, np.eye(4), 0.4, np.inf, 0.8, refined=True),
    ]
    graph = LoopGraph(rows, poses[rows], None, loops, breaks=(5,))
    done = Optimized(poses[rows], np.array([True, False])) if optimized else None
    return DriveResult(track, graph, -1.7, done, Truth.whole(poses) if truth else None)
