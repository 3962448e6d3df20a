"""A loop graph as files that pose-graph back ends read: g2o, and loops as rows of numbers."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from deepring.localization.drives.graph_noise import loop_covariance, odometry_covariances
from deepring.localization.drives.loop_graph import Loop, LoopGraph


def g2o_lines(graph: LoopGraph, loops: Sequence[Loop] | None = None) -> Iterator[str]:
    """Lines of a g2o file in SE(3): one vertex per keyframe, and edges for odometry and loops.

    An edge states the pose of its second vertex in the frame of its first, x y z qx qy qz qw, and
    the upper triangle of its information, row by row: x, y, z in metres, then the rotation vector
    in radians, as GTSAM and Ceres read them (g2o itself counts the half of each angle, and so
    weighs turns by a quarter). ``loops`` are those of the graph by default.
    """
    for k, pose in enumerate(graph.poses):
        yield f"VERTEX_SE3:QUAT {k} {_pose(pose)}"
    for k, covariance in enumerate(odometry_covariances(graph)):
        yield _edge(k, k + 1, np.linalg.inv(graph.poses[k]) @ graph.poses[k + 1], covariance)
    for loop in graph.loops if loops is None else loops:
        yield _edge(loop.earlier, loop.keyframe, loop.transform, loop_covariance(loop))


def loop_lines(loops: Sequence[Loop]) -> Iterator[str]:
    """Loops as text: keyframes i and j, and the 4 x 4 pose of j in the frame of i, row by row."""
    yield "# i j T: keyframes, and the 4 x 4 pose of j in the frame of i, row by row"
    for loop in loops:
        numbers = " ".join(f"{value:.9f}" for value in loop.transform.ravel())
        yield f"{loop.earlier} {loop.keyframe} {numbers}"


def _edge(
    first: int, second: int, transform: NDArray[np.float64], covariance: NDArray[np.float64]
) -> str:
    information = np.linalg.inv(covariance)
    entries = " ".join(f"{value:.9g}" for value in information[np.triu_indices(6)])
    return f"EDGE_SE3:QUAT {first} {second} {_pose(transform)} {entries}"


def _pose(transform: NDArray[np.float64]) -> str:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(transform[:3, :3]).as_quat()
    return " ".join(f"{value:.9f}" for value in (*transform[:3, 3], *turn))
