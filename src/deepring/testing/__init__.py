"""Checks for methods: `check_method` asserts the properties that every method must have.

from deepring.testing import check_method

def test_mine():
    check_method(Mine())
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.rigid import turn_points
from deepring.methods.method import Method, RelativePoses
from deepring.testing.failure import TOLERANCE, away, difference
from deepring.testing.failure import MethodError as MethodError
from deepring.testing.storage import check_file as check_file
from deepring.testing.storage import check_index as check_index

#: Number of simulated scans, used when the caller passes no rasters.
SCANS = 8

#: Tolerance of turns, radians: less than half the distance to the opposite turn, also modulo π.
TURN_TOLERANCE = math.radians(25)

#: The turn that a method must find, radians: a whole number of sectors of common rasters.
TURN = math.radians(60)

#: Labels of simulated points: building, fence, trunk, pole, traffic sign.
_LABELS = np.array([50, 51, 71, 80, 81])


def check_method(method: Method, rasters: Tensor | None = None, seed: int = 0) -> dict[str, str]:
    """Assert that a method describes and compares scans as the package expects.

    Args:
        method: trained or not, of any size.
        rasters: (n, *method.raster.shape) of n different scans, at least 3; by default, scans of
            random walls.
        seed: random seed of the walls.

    Returns:
        The properties that do not apply to the method, each with the reason.

    Raises:
        MethodError: an AssertionError for the first property that the method lacks.
    """
    if rasters is None:
        rasters = rasterize(method, [walls(seed + k) for k in range(SCANS)])
    if len(rasters) < 3:
        raise MethodError("rasters", f"{len(rasters)} scans, expected at least 3")
    descriptors = check_shapes(method, rasters)
    check_determinism(method, rasters, descriptors)
    check_empty_batch(method, rasters, descriptors)
    check_self_similarity(method, descriptors)
    check_relative_poses(method, rasters)
    skipped = {
        "turn": check_turn(method, seed),
        "index": check_index(method, descriptors),
        "file": check_file(method, rasters, descriptors),
    }
    return {name: reason for name, reason in skipped.items() if reason}


def walls(seed: int, radius: float = 45.0) -> NDArray[np.float32]:
    """Points (n, 3) of a simulated scan among random walls, metres, with the ground at z = 0."""
    rng = np.random.default_rng(seed)
    points = []
    for _ in range(40):
        centre, angle = rng.uniform(-0.7 * radius, 0.7 * radius, 2), rng.uniform(0, np.pi)
        along = rng.uniform(-10, 10, 100)
        wall = centre + along[:, None] * [np.cos(angle), np.sin(angle)]
        points.append(np.column_stack([wall, rng.uniform(0.5, 8.0, 100)]))
    cloud = np.concatenate(points).astype(np.float32)
    return cloud[np.hypot(cloud[:, 0], cloud[:, 1]) < radius]


def rasterize(method: Method, scans: list[NDArray[np.float32]]) -> Tensor:
    """Rasters (n, *method.raster.shape) of n scans (m, 3), with what else the raster takes."""
    raster = method.raster
    rows = [with_columns(points, getattr(raster, "columns", ())) for points in scans]
    return torch.from_numpy(np.stack([raster(points, 0.0) for points in rows]))


def with_columns(points: NDArray[np.float32], columns: Sequence[str]) -> NDArray[np.float32]:
    """Points (m, 3 + k) of points (m, 3): twenty in a row of one label, other columns in [0, 1).

    Labels are those of what stands, as SemanticKITTI has them.

    >>> with_columns(np.zeros((60, 3), dtype=np.float32), ["label"])[::20, 3]
    array([50., 51., 71.], dtype=float32)
    """
    order = np.arange(len(points))
    values = [
        _LABELS[order // 20 % len(_LABELS)] if name == "label" else order % 17 / 17
        for name in columns
    ]
    return np.column_stack([points, *(value.astype(points.dtype) for value in values)])


def check_shapes(method: Method, rasters: Tensor) -> Tensor:
    """Assert finite float32 descriptors, one a raster, scores and turns (q, d) in [-π, π] or None.

    Returns the descriptors.
    """
    shape = tuple(method.raster.shape)
    if tuple(rasters.shape[1:]) != shape:
        raise MethodError(
            "shapes", f"rasters {tuple(rasters.shape)}, expected (n, {', '.join(map(str, shape))})"
        )
    descriptors = method.describe(rasters)
    if not isinstance(descriptors, Tensor) or descriptors.dtype != torch.float32:
        kind = descriptors.dtype if isinstance(descriptors, Tensor) else type(descriptors).__name__
        raise MethodError(
            "shapes",
            f"describe returns {kind}, expected a Tensor of torch.float32, which is all that files "
            "of descriptors hold",
        )
    if descriptors.ndim < 2 or len(descriptors) != len(rasters):
        raise MethodError(
            "shapes",
            f"describe returns {tuple(descriptors.shape)} for {len(rasters)} rasters, expected "
            f"({len(rasters)}, ...)",
        )
    bad = int((~torch.isfinite(descriptors)).sum())
    if bad:
        raise MethodError("shapes", f"{bad} of {descriptors.numel()} numbers are not finite")
    score, turn = method.compare(descriptors[:2], descriptors)
    pairs = (2, len(descriptors))
    for name, values in (("score", score), ("turn", turn)):
        if values is None and name == "turn":
            continue
        if not isinstance(values, Tensor) or not values.is_floating_point():
            raise MethodError("shapes", f"{name} of compare, expected a floating Tensor")
        if tuple(values.shape) != pairs:
            raise MethodError(
                "shapes",
                f"compare returns a {name} of {tuple(values.shape)} for 2 queries and "
                f"{len(descriptors)} entries, expected {pairs}",
            )
    if not torch.isfinite(score).all():
        raise MethodError("shapes", f"{int((~torch.isfinite(score)).sum())} scores are not finite")
    if turn is not None and bool((turn.abs() > math.pi + 1e-4).any()):
        raise MethodError(
            "shapes", f"a turn of {float(turn.abs().nan_to_num().max()):.3f}, expected [-π, π]"
        )
    return descriptors


def check_determinism(method: Method, rasters: Tensor, descriptors: Tensor) -> None:
    """Assert that descriptors repeat, for the same batch and for one scan at a time."""
    error = difference(method.describe(rasters), descriptors)
    if error > 0:
        raise MethodError(
            "determinism", f"described twice, descriptors differ by {error:.3g}, expected 0"
        )
    single = torch.cat([method.describe(rasters[k : k + 1]) for k in range(len(rasters))])
    error = difference(single, descriptors)
    if not error <= TOLERANCE:
        raise MethodError(
            "determinism",
            f"described one at a time, descriptors differ by {error:.3g} of the largest number "
            f"from those of one batch, expected at most {TOLERANCE:g}: a scan's descriptor must "
            "not depend on the other scans of its batch",
        )


def check_empty_batch(method: Method, rasters: Tensor, descriptors: Tensor) -> None:
    """Assert that empty batches of rasters, queries and entries give empty results."""
    none = (0, *descriptors.shape[1:])
    try:
        empty = method.describe(rasters[:0])
    except Exception as error:
        raise MethodError(
            "empty batch",
            f"describe raises {type(error).__name__} for 0 rasters, expected {none}",
        ) from error
    if tuple(empty.shape) != none:
        raise MethodError(
            "empty batch",
            f"describe returns {tuple(empty.shape)} for 0 rasters, expected {none}",
        )
    for queries, database in ((empty, descriptors), (descriptors, empty)):
        size = (len(queries), len(database))
        try:
            shape = tuple(method.compare(queries, database).score.shape)
        except Exception as error:
            raise MethodError(
                "empty batch",
                f"compare raises {type(error).__name__} for {size[0]} queries and {size[1]} "
                f"entries, expected scores {size}",
            ) from error
        if shape != size:
            raise MethodError("empty batch", f"compare returns scores {shape}, expected {size}")


def check_self_similarity(method: Method, descriptors: Tensor) -> None:
    """Assert that each scan scores highest with itself, and lower with at least one other scan."""
    score = method.compare(descriptors, descriptors).score
    diagonal, best = score.diagonal(), score.max(dim=1)
    slack = TOLERANCE * float(score.abs().max())
    k = int((best.values - diagonal).argmax())
    if float(best.values[k] - diagonal[k]) > slack:
        raise MethodError(
            "self-similarity",
            f"scan {k} scores {float(diagonal[k]):.6g} with itself and {float(best.values[k]):.6g} "
            f"with scan {int(best.indices[k])}, expected its own score to be the highest",
        )
    spread = float((diagonal - score.min(dim=1).values).min())
    if not spread > 0:
        raise MethodError(
            "self-similarity",
            f"a scan scores {float(diagonal[0]):.6g} with all {len(score)} scans, expected a lower "
            "score with other scans than with itself",
        )


def check_relative_poses(method: Method, rasters: Tensor) -> None:
    """Assert that a method with `RelativePoses` gives rigid transforms (k, 4, 4), or NaN."""
    if not isinstance(method, RelativePoses):
        return
    for k in (2, 0):
        poses = method.relative_poses(rasters[0], rasters[:k])
        if poses.dtype != torch.float64 or tuple(poses.shape) != (k, 4, 4):
            raise MethodError(
                "relative poses",
                f"{poses.dtype} {tuple(poses.shape)} for {k} places, expected float64 ({k}, 4, 4)",
            )
        told = poses[~poses.isnan().flatten(1).all(dim=1)].cpu()
        turns, last = told[:, :3, :3], torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64)
        apart = (turns @ turns.mT - torch.eye(3, dtype=torch.float64)).abs()
        if (apart > TOLERANCE).any() or (turns.det() < 0).any() or (told[:, 3] != last).any():
            raise MethodError(
                "relative poses", f"{told.tolist()}, expected rigid transforms, or NaN throughout"
            )


def check_turn(method: Method, seed: int = 0) -> str:
    """Assert that `compare` finds by how much the points are turned from entry to query.

    The turn counts modulo the method's ``turn_period``, and for most scans: a few may look alike
    in two directions. Returns why the check does not apply, or ''.
    """
    scans = [walls(seed + k) for k in range(SCANS)]
    entries = method.describe(rasterize(method, scans))
    period = float(getattr(method, "turn_period", 2 * math.pi))
    if method.compare(entries[:1], entries[:1]).turn is None:
        return "compare returns no turn"
    queries = method.describe(rasterize(method, [turn_points(points, TURN) for points in scans]))
    turns = torch.cat(
        [_turn_of(method, query, entry) for query, entry in zip(queries, entries, strict=True)]
    )
    right, opposite = (
        int((away(turns - turn, period) <= TURN_TOLERANCE).sum()) for turn in (TURN, -TURN)
    )
    if 2 * right > len(turns):
        return ""
    degrees = [round(value) for value in torch.rad2deg(turns).tolist()]
    sign = " (of the opposite sign)" if 2 * opposite > len(turns) else ""
    raise MethodError(
        "turn",
        f"the points were turned by {math.degrees(TURN):.0f}° from entry to query, and compare "
        f"returns {degrees} degrees{sign}; expected most of them within "
        f"{math.degrees(TURN_TOLERANCE):.0f}° of that turn, modulo {math.degrees(period):.0f}°",
    )


def _turn_of(method: Method, query: Tensor, entry: Tensor) -> Tensor:
    turn = method.compare(query[None], entry[None]).turn
    assert turn is not None
    return turn[0]
