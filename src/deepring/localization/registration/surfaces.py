"""Surfaces that two scans share: matched points with normals, and the pose that joins them.

GICP comes close and stays beside: rings on the ground pull each other, and its regularised
Gaussians hold points along their surface too. Passes point to plane follow it, over surfaces whose
normals agree in both scans, with Cauchy's weights. On simulated pairs up to 20 m apart the errors
are then a half to a quarter (`benchmarks/pose_covariance.py`).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from deepring.core.rigid import FloatArray

#: Largest angle between the normals of one surface.
SAME_SURFACE = math.cos(math.radians(15))

#: Least standard deviation of matched surfaces, metres.
LEAST_NOISE = 0.01

#: Passes over the matches, and the step that ends them: metres and radians.
_PASSES, _SHORT = 8, 2e-4


class Surfaces(NamedTuple):
    """n matched surfaces of two scans, all in the reference's frame."""

    points: FloatArray
    """(n, 3) of the query, metres."""
    arms: FloatArray
    """(n, 3) from the query's sensor to the points, metres."""
    gaps: FloatArray
    """(n,) from the reference's surfaces to the query's points, along the normals, metres."""
    normals: FloatArray
    """(2, n, 3) of the reference and of the query, to the same side."""

    @property
    def noise(self) -> float:
        """Standard deviation of the gaps, metres, whatever outliers say; infinite for none."""
        if not len(self.gaps):
            return math.inf
        return max(LEAST_NOISE, 1.4826 * float(np.median(np.abs(self.gaps))))

    @property
    def weights(self) -> FloatArray:
        """(n,) up to 1: Cauchy's, squared, so that what belongs to nothing weighs nothing."""
        return np.asarray((1 + (self.gaps / (2 * self.noise)) ** 2) ** -2.0)


def no_surfaces() -> Surfaces:
    """Of scans that share nothing."""
    return Surfaces(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty((2, 0, 3)))


def matched_surfaces(
    target: Any, tree: Any, source: Any, transform: FloatArray, reach: float
) -> Surfaces:
    """Surfaces of a source within ``reach`` metres of the target's, clouds of small_gicp."""
    rotation, sensor = transform[:3, :3], transform[:3, 3]
    arms = source.points()[:, :3] @ rotation.T
    nearest, squared = tree.batch_nearest_neighbor_search(arms + sensor)
    other = np.asarray(nearest).ravel()
    first, second = target.normals()[other, :3], source.normals()[:, :3] @ rotation.T
    alike = np.sum(first * second, axis=1)
    one = (np.asarray(squared).ravel() <= reach**2) & (np.abs(alike) >= SAME_SURFACE)
    first, second = first[one], np.sign(alike[one, None]) * second[one]
    points = arms[one] + sensor
    gaps = np.sum((points - target.points()[other[one], :3]) * _middle(first, second), axis=1)
    return Surfaces(points, arms[one], gaps, np.stack([first, second]))


def brought_together(
    target: Any, tree: Any, source: Any, start: FloatArray, reach: float, loose: FloatArray
) -> tuple[FloatArray, bool]:
    """The transform (4, 4) that brings the surfaces together, and whether its last step was short.

    Directions that no surface holds stay at ``start``, as far as ``loose`` allows: the standard
    deviations (6,) of x, y, z, metres, and of the rotation about the axes, radians.
    """
    transform, moved, known = start, np.zeros(6), np.diag(loose**-2.0)
    for _ in range(_PASSES):
        surfaces = matched_surfaces(target, tree, source, transform, reach)
        if not len(surfaces.gaps):
            return transform, False
        rows = lever_rows(_middle(*surfaces.normals), surfaces.arms)
        weighted = rows.T * (surfaces.weights / surfaces.noise**2)
        pull = weighted @ surfaces.gaps + known @ moved
        step: FloatArray = np.negative(np.linalg.solve(weighted @ rows + known, pull), dtype=float)
        transform, moved = moved_by(transform, step), moved + step
        if np.abs(step).max() < _SHORT:
            return transform, True
    return transform, False


def moved_by(transform: FloatArray, step: FloatArray) -> FloatArray:
    """A transform after a shift and a small rotation (6,) along the reference's axes."""
    after = transform.copy()
    after[:3, 3] += step[:3]
    after[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix() @ transform[:3, :3]
    return after


def lever_rows(normals: FloatArray, arms: FloatArray) -> FloatArray:
    """(n, 6): how a shift and a rotation of the pose open the gaps."""
    return np.hstack([normals, np.cross(arms, normals)])


def _middle(first: FloatArray, second: FloatArray) -> FloatArray:
    """The normals (n, 3) between two, which point to the same side."""
    both = first + second
    return np.asarray(both / np.linalg.norm(both, axis=1, keepdims=True))
