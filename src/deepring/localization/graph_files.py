"""A loop graph as files that pose-graph back ends and trajectory tools read."""

import json
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from deepring.core.rigid import yaw_of
from deepring.data.poses.stamps import NANOSECONDS, seconds_text
from deepring.localization.loops import LoopGraph

#: Standard deviations of the edges, metres and degrees.
ODOMETRY, LOOP = (0.1, 0.5), (0.5, 1.0)


def g2o_lines(graph: LoopGraph) -> Iterator[str]:
    """Lines of a g2o file in SE(2): one vertex per keyframe, and edges for odometry and loops.

    An edge states the pose of its second vertex in the frame of its first, and its information;
    see `ODOMETRY` and `LOOP`.
    """
    planar = np.column_stack([graph.poses[:, :2, 3], yaw_of(graph.poses)])
    for k, (x, y, yaw) in enumerate(planar):
        yield f"VERTEX_SE2 {k} {x:.6f} {y:.6f} {yaw:.8f}"
    for k in range(len(planar) - 1):
        relative = np.linalg.inv(graph.poses[k]) @ graph.poses[k + 1]
        yaw = float(yaw_of(relative))
        yield _edge(k, k + 1, relative[0, 3], relative[1, 3], yaw, ODOMETRY)
    for loop in graph.loops:
        yield _edge(loop.earlier, loop.keyframe, loop.x, loop.y, loop.yaw, LOOP)


def tum_lines(graph: LoopGraph) -> Iterator[str]:
    """The keyframes' poses in TUM's format: seconds x y z qx qy qz qw.

    Stamps are exact to the nanosecond. Without, the seconds are the number of the keyframe.
    """
    from scipy.spatial.transform import Rotation

    n = len(graph.poses)
    stamps = np.arange(n) * NANOSECONDS if graph.stamps is None else graph.stamps
    turns = Rotation.from_matrix(graph.poses[:, :3, :3]).as_quat()
    for stamp, pose, turn in zip(stamps, graph.poses, turns, strict=True):
        numbers = " ".join(f"{value:.9f}" for value in (*pose[:3, 3], *turn))
        yield f"{seconds_text(stamp)} {numbers}"


def json_text(graph: LoopGraph) -> str:
    """Keyframes as numbers of their scans, their stamps in nanoseconds or null, and the loops.

    A ratio without a rival is null.
    """
    loops = [asdict(loop) for loop in graph.loops]
    for loop in loops:
        loop["ratio"] = loop["ratio"] if np.isfinite(loop["ratio"]) else None
    stamps = None if graph.stamps is None else graph.stamps.tolist()
    return json.dumps({"scans": graph.scans.tolist(), "stamps": stamps, "loops": loops}, indent=1)


def _edge(
    first: int, second: int, x: float, y: float, yaw: float, deviation: tuple[float, float]
) -> str:
    flat, turn = 1 / deviation[0] ** 2, 1 / np.radians(deviation[1]) ** 2
    return (
        f"EDGE_SE2 {first} {second} {x:.6f} {y:.6f} {yaw:.8f} "
        f"{flat:.6g} 0 0 {flat:.6g} 0 {turn:.6g}"
    )
