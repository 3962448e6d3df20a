"""A pose refined on the points themselves: GICP, from where an alignment of images left it."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deepring.core.rigid import FloatArray, pose_from, rotation_from_rpy, yaw_after_turn, yaw_of
from deepring.errors import DeepringError


@dataclass(frozen=True)
class RefinementSettings:
    """Of the registration, and of how far it may go from its start."""

    voxel: float = 0.5
    """Points are thinned to one in each, metres."""
    reaches: tuple[float, ...] = (2.0, 0.5)
    """Largest distance of points that are matched, metres, of passes one after the other: the
    first decides how far off the start may be, the last counts inliers."""
    iterations: int = 50
    """At most, a pass."""
    max_shift: float = 4.0
    """Metres along x and y from the start, from which on the result is not believed. Height and
    tilt are not limited: the start knows nothing of them."""
    max_turn: float = math.radians(10.0)
    """Turn from the start, likewise; radians."""

    def __post_init__(self) -> None:
        for name in ("voxel", "iterations", "max_shift", "max_turn"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise DeepringError(f"refinement.{name}: {value}, expected more than 0")
        if not self.reaches or not all(0 < reach < math.inf for reach in self.reaches):
            raise DeepringError(
                f"refinement.reaches: {self.reaches}, expected one or more metres above 0"
            )


class Refined(NamedTuple):
    """Where a query lies in the frame of a map scan; the start, unless ``converged``."""

    transform: FloatArray
    """(4, 4) reference <- query."""
    turn: float
    """Radians in [-π, π), the turn of the points from map scan to query, as in `Alignment`."""
    position: FloatArray
    """(2,) metres, of the query's sensor in the map scan's frame, as in `Alignment`."""
    inliers: float
    """Share of the query's thinned points matched in the last pass, where that ended."""
    converged: bool
    """Whether the registration settled near its start, which is not whether the start was right:
    of that the inliers tell, and the fit of the alignment."""
    error: float
    """GICP's squared error an inlier, without a unit; infinite where there are none."""


def refine(
    query: NDArray[np.float32],
    reference: NDArray[np.float32],
    turn: float,
    position: ArrayLike,
    settings: RefinementSettings | None = None,
) -> Refined:
    """Refine the pose of one scan in another's frame on their points.

    Args:
        query: (n, 3) metres, z up.
        reference: (m, 3) of the map scan, metres, z up.
        turn: radians, the turn of the points from map scan to query.
        position: (2,) metres, of the query's sensor in the map scan's frame.
        settings: of the registration.

    Raises:
        DeepringError: without the library; scans that are empty or hold numbers that are none.
    """
    settings = settings or RefinementSettings()
    library = small_gicp()
    target, tree = library.preprocess_points(_expect("reference", reference), settings.voxel)
    source, _ = library.preprocess_points(_expect("query", query), settings.voxel)
    start = start_of(turn, position)
    found = start
    for reach in settings.reaches:
        result = library.align(
            target,
            source,
            tree,
            found,
            max_correspondence_distance=reach,
            max_iterations=settings.iterations,
        )
        found = np.asarray(result.T_target_source, dtype=np.float64)
    converged = bool(result.converged) and result.num_inliers > 0 and _near(found, start, settings)
    transform = found if converged else start
    return Refined(
        transform,
        yaw_after_turn(0.0, float(yaw_of(transform))),
        transform[:2, 3].copy(),
        result.num_inliers / source.size(),
        converged,
        result.error / result.num_inliers if result.num_inliers else math.inf,
    )


def start_of(turn: float, position: ArrayLike) -> FloatArray:
    """The transform (4, 4) reference <- query of a planar pose as `Alignment` has it."""
    x, y = np.asarray(position, dtype=np.float64)
    return pose_from(rotation_from_rpy(0.0, 0.0, yaw_after_turn(0.0, turn)), [x, y, 0.0])


def small_gicp() -> Any:
    """The library. Raises DeepringError where it is not installed."""
    try:
        import small_gicp as library
    except ImportError as error:
        raise DeepringError(
            f"refinement: {error}; it needs small_gicp: pip install 'deepring[refine]'"
        ) from error
    return library


def _near(found: FloatArray, start: FloatArray, settings: RefinementSettings) -> bool:
    if not np.isfinite(found).all():
        return False
    shift = float(np.linalg.norm(found[:2, 3] - start[:2, 3]))
    turn = float(yaw_of(start[:3, :3].T @ found[:3, :3]))
    return shift <= settings.max_shift and abs(turn) <= settings.max_turn


def _expect(name: str, points: NDArray[np.float32]) -> FloatArray:
    if points.ndim != 2 or points.shape[1] < 3 or not len(points):
        raise DeepringError(
            f"refinement: {name} of shape {points.shape}, expected (n, 3) with at least one point"
        )
    wide = points[:, :3].astype(np.float64)
    if not np.isfinite(wide).all():
        raise DeepringError(
            f"refinement: {name} with coordinates that are no numbers; drop those points"
        )
    return wide
