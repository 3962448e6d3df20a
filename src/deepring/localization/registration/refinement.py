"""Refinement of a pose on the points themselves: GICP, started from an alignment of images."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deepring import checks
from deepring.core.arrays import real_array
from deepring.core.rigid import FloatArray, planar_pose, yaw_after_turn, yaw_of
from deepring.errors import ConfigError, DataError
from deepring.localization.registration.pose_covariance import pose_uncertainty
from deepring.localization.registration.surfaces import (
    Surfaces,
    brought_together,
    matched_surfaces,
    no_surfaces,
)
from deepring.localization.scan_points import scan_points


@dataclass(frozen=True)
class RefinementSettings:
    """Settings of the registration, and how far it may move from its start."""

    voxel: float = 0.5
    """Side of a voxel, metres; points are thinned to one per voxel."""
    reaches: tuple[float, ...] = (2.0, 0.5)
    """Largest distances between matched points, metres, one per pass. The first decides how far off
    the start may be, the last which points are inliers."""
    iterations: int = 50
    """Largest number per pass."""
    max_shift: float = 4.0
    """Largest shift from the start along x and y, metres; with a larger one the registration has
    not converged. Height and tilt are not limited, since the start does not know them."""
    max_turn: float = math.radians(10.0)
    """Largest turn from the start, radians, likewise."""

    def __post_init__(self) -> None:
        checks.count("refinement.iterations", self.iterations)
        for name in ("voxel", "max_shift", "max_turn"):
            checks.positive(f"refinement.{name}", getattr(self, name))
        if not self.reaches:
            raise ConfigError("refinement.reaches: (), expected one or more metres above 0")
        for reach in self.reaches:
            checks.positive("refinement.reaches", reach, "metres")


class Refinement(NamedTuple):
    """Pose of a query in the frame of a map scan; the start, unless ``converged``."""

    transform: FloatArray
    """(4, 4) reference <- query."""
    turn: float
    """Radians in [-π, π), the turn of the points from map scan to query, as in `Alignment`."""
    position: FloatArray
    """(2,) metres, of the query's sensor in the map scan's frame, as in `Alignment`."""
    inliers: float
    """Share of the query's thinned points that match at the end of the last pass."""
    converged: bool
    """Whether the registration settled near its start. Whether the start was right, the inliers and
    the fit of the alignment tell."""
    error: float
    """GICP's squared error per inlier, without a unit; infinite where there are none."""
    covariance: FloatArray
    """(6, 6) of x, y, z, roll, pitch, yaw along the axes of the map scan, metres and radians; see
    `deepring.localization.registration.pose_covariance`. Unless ``converged``, as large as the
    range that the registration may move in."""
    unobservable: FloatArray
    """(k, 6) directions that no surface holds, as in `PoseUncertainty`."""


class Registration(NamedTuple):
    """How a registration ended, whatever one thinks of it."""

    transform: FloatArray
    """(4, 4) reference <- query."""
    inliers: float
    """Share of the query's thinned points that match."""
    settled: bool
    """Whether the last step was short."""
    error: float
    """As in `Refinement`."""
    surfaces: Surfaces
    """Those that both scans show."""
    by_gicp: FloatArray
    """(4, 4) where GICP ended, from which the surfaces were brought together."""
    hessian: FloatArray
    """(6, 6) of GICP there, for by_gicp · Exp(rotation, translation)."""


def refine(
    query: Any,
    reference: Any,
    turn: float,
    position: ArrayLike,
    settings: RefinementSettings | None = None,
) -> Refinement:
    """Refine the pose of one scan in the frame of another on the points of both.

    Args:
        query: (n, 3) metres, z up.
        reference: (m, 3) of the map scan, metres, z up.
        turn: radians, the turn of the points from map scan to query.
        position: (2,) metres, of the query's sensor in the map scan's frame.
        settings: the registration.

    Raises:
        ConfigError: small_gicp is not installed.
        DataError: a scan without points, or a start that is not finite.
    """
    settings = settings or RefinementSettings()
    start = start_of(turn, position)
    query, reference = _scan("query", query), _scan("reference", reference)
    return settled(register(query, reference, start, settings), start, settings)


def settled(found: Registration, start: FloatArray, settings: RefinementSettings) -> Refinement:
    """What a registration gives; its start (4, 4) where it did not settle near that."""
    near = _near(found.transform, start, settings)
    converged = found.settled and found.inliers > 0 and near
    transform = found.transform if converged else start
    surfaces = found.surfaces if converged else no_surfaces()
    known = pose_uncertainty(surfaces, settings.max_shift, settings.max_turn)
    return Refinement(
        transform,
        yaw_after_turn(0.0, float(yaw_of(transform))),
        transform[:2, 3].copy(),
        found.inliers,
        converged,
        found.error,
        known.covariance,
        known.unobservable,
    )


def register(
    query: FloatArray, reference: FloatArray, start: FloatArray, settings: RefinementSettings
) -> Registration:
    """Register points (n, 3) on points (m, 3), metres, float64, from a start (4, 4).

    Raises ConfigError if small_gicp is not installed.
    """
    library = small_gicp()
    target, tree = library.preprocess_points(reference, settings.voxel)
    source, _ = library.preprocess_points(query, settings.voxel)
    transform = start
    for reach in settings.reaches:
        result = library.align(
            target,
            source,
            tree,
            transform,
            max_correspondence_distance=reach,
            max_iterations=settings.iterations,
        )
        transform = np.asarray(result.T_target_source, dtype=np.float64)
    by_gicp, reach = transform, settings.reaches[-1]
    surfaces, short = no_surfaces(), False
    if np.isfinite(transform).all():
        loose = np.repeat([settings.max_shift, settings.max_turn], 3)
        transform, short = brought_together(target, tree, source, transform, reach, loose)
        surfaces = matched_surfaces(target, tree, source, transform, reach)
    return Registration(
        transform,
        result.num_inliers / source.size(),
        short or bool(result.converged),
        result.error / result.num_inliers if result.num_inliers else math.inf,
        surfaces,
        by_gicp,
        np.asarray(result.H, dtype=np.float64),
    )


def start_of(turn: float, position: ArrayLike) -> FloatArray:
    """The transform (4, 4) reference <- query of a planar pose, as in `Alignment`.

    Raises ConfigError for a turn, and DataError for a position, that is not finite.
    """
    checks.number("turn", turn, "radians")
    start = real_array("position", position)
    if start.shape != (2,) or not np.isfinite(start).all():
        raise DataError(f"position: {start!r}, expected two finite numbers, x and y in metres")
    x, y = start.astype(np.float64)
    return planar_pose(x, y, yaw_after_turn(0.0, turn))


def small_gicp() -> Any:
    """The library. Raises ConfigError if it is not installed."""
    return checks.installed("refinement", "small_gicp", "small_gicp", "refine")


def _near(transform: FloatArray, start: FloatArray, settings: RefinementSettings) -> bool:
    if not np.isfinite(transform).all():
        return False
    shift = float(np.linalg.norm(transform[:2, 3] - start[:2, 3]))
    turn = float(yaw_of(start[:3, :3].T @ transform[:3, :3]))
    return shift <= settings.max_shift and abs(turn) <= settings.max_turn


def _scan(name: str, points: Any) -> FloatArray:
    """The points (n, 3) as the library expects them."""
    return scan_points(f"refinement: {name}", points).astype(np.float64)
