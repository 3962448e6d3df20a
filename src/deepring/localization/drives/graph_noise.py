"""How far the edges of a loop graph may be off, where the registration does not tell.

Covariances (6, 6) are of inv(edge) @ truth in the frame of the edge's second keyframe: x, y, z in
metres, then the rotation vector in radians.
"""

import numpy as np
from numpy.typing import NDArray

from deepring.localization.drives.loop_graph import Loop, LoopGraph

#: Standard deviations of an odometry edge of one metre, metres and degrees; the variances grow with
#: the length, as of independent steps. `benchmarks/trajectory.py` prints those of drives: 0.02 m
#: and 0.04° for its simulated drift; more, now and then, for KISS-ICP on scans 2 m apart.
ODOMETRY = (0.03, 0.1)
#: Metres. Shorter edges are no better: the registration itself is off.
SHORTEST = 1.0
#: A break of the odometry, metres and degrees: anything.
BREAK = (100.0, 90.0)
#: A loop refined on the points: x, y, z in metres, roll, pitch, yaw in degrees. Added to the
#: covariance of its registration, which takes both scans for rigid and says which directions no
#: surface holds.
REFINED = (0.1, 0.1, 0.1, 0.5, 0.5, 0.5)
#: A loop of images alone, which show neither height nor tilt.
PLANAR = (0.5, 0.5, 1.5, 4.0, 4.0, 1.0)


def odometry_covariances(graph: LoopGraph) -> NDArray[np.float64]:
    """(n - 1, 6, 6), of the edges from each keyframe to the next."""
    steps = np.linalg.norm(np.diff(graph.poses[:, :3, 3], axis=0), axis=1)
    grown = np.sqrt(np.maximum(steps, SHORTEST))[:, None]
    deviations = grown * _deviations((*[ODOMETRY[0]] * 3, *[ODOMETRY[1]] * 3))
    for k in graph.breaks:
        deviations[k - 1] = _deviations((*[BREAK[0]] * 3, *[BREAK[1]] * 3))
    covariances = np.zeros((len(deviations), 6, 6))
    covariances[:, range(6), range(6)] = deviations**2
    return covariances


def loop_covariance(loop: Loop) -> NDArray[np.float64]:
    """(6, 6), with the registration's own where it has one."""
    usual = np.diag(_deviations(REFINED if loop.refined else PLANAR) ** 2)
    return usual if loop.covariance is None else usual + loop.covariance


def _deviations(values: tuple[float, ...]) -> NDArray[np.float64]:
    """Metres and degrees as metres and radians."""
    return np.array([*values[:3], *np.radians(values[3:])])
