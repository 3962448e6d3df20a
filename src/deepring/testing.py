"""Checks for methods: `check_method` asserts the properties that every method must have.

from deepring.testing import check_method

def test_mine():
    check_method(Mine())
"""

import json
import math
import tempfile
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.rigid import turn_points
from deepring.evaluation.fingerprint import fingerprint, first_difference
from deepring.methods.method import Method, index_of, rebuild_method
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import TrainedNetwork, read_network, write_network

#: Number of simulated scans, used when the caller passes no rasters.
SCANS = 8

#: Tolerance of scores relative to the largest: sums differ slightly with the batch size.
TOLERANCE = 1e-4

#: Tolerance of turns, radians: less than half the distance to the opposite turn, also modulo π.
TURN_TOLERANCE = math.radians(25)

#: The turn that a method must find, radians: a whole number of sectors of common rasters.
TURN = math.radians(60)


class MethodError(AssertionError):
    """Raised for a property that a method lacks; the message says by how much."""

    def __init__(self, property: str, message: str) -> None:
        super().__init__(f"{property}: {message}")
        self.property = property


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
    """Rasters (n, *method.raster.shape) of n scans (m, 3)."""
    return torch.from_numpy(np.stack([method.raster(points, 0.0) for points in scans]))


def check_shapes(method: Method, rasters: Tensor) -> Tensor:
    """Assert one finite descriptor per raster, scores (q, d), and turns (q, d) in [-π, π] or None.

    Returns the descriptors.
    """
    shape = tuple(method.raster.shape)
    if tuple(rasters.shape[1:]) != shape:
        raise MethodError(
            "shapes", f"rasters {tuple(rasters.shape)}, expected (n, {', '.join(map(str, shape))})"
        )
    descriptors = method.describe(rasters)
    if not isinstance(descriptors, Tensor) or not descriptors.is_floating_point():
        kind = descriptors.dtype if isinstance(descriptors, Tensor) else type(descriptors).__name__
        raise MethodError("shapes", f"describe returns {kind}, expected a floating Tensor")
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
    error = _difference(method.describe(rasters), descriptors)
    if error > 0:
        raise MethodError(
            "determinism", f"described twice, descriptors differ by {error:.3g}, expected 0"
        )
    single = torch.cat([method.describe(rasters[k : k + 1]) for k in range(len(rasters))])
    error = _difference(single, descriptors)
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
        int((_away(turns - turn, period) <= TURN_TOLERANCE).sum()) for turn in (TURN, -TURN)
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


def check_index(method: Method, descriptors: Tensor) -> str:
    """Assert that the method's index agrees with `compare` in scores, order and turns.

    Returns ''.
    """
    half = len(descriptors) // 2
    queries, database = descriptors[::2], descriptors
    index = index_of(method)
    index.add(database[:half])
    index.add(database[half:])
    if len(index) != len(database):
        raise MethodError("index", f"holds {len(index)} of {len(database)} places that were added")
    score, turn = method.compare(queries, database)
    hits = index.search(queries, len(database))
    slack = TOLERANCE * float(score.abs().max())
    # A method may compare only some entries with a query and give the rest one lowest score.
    width = hits.place.shape[1]
    best = score.sort(dim=1, descending=True).values[:, :width]
    error = float((hits.score - best).abs().max())
    if width < 1 or not error <= slack:
        raise MethodError(
            "index",
            f"the best {width} scores differ by {error:.3g} from those of compare, expected at "
            f"most {slack:.3g}",
        )
    error = float((hits.score - score.gather(1, hits.place)).abs().max())
    if not error <= slack:
        raise MethodError(
            "index",
            f"the scores of its places differ by {error:.3g} from those of compare for the same "
            f"places, expected at most {slack:.3g}",
        )
    if (turn is None) != (hits.turn is None):
        with_turn, without = (
            ("compare", "the index") if hits.turn is None else ("the index", "compare")
        )
        raise MethodError("index", f"{with_turn} returns turns, but {without} does not")
    if turn is not None and hits.turn is not None:
        period = float(getattr(method, "turn_period", 2 * math.pi))
        errors = _away(hits.turn - turn.gather(1, hits.place), period).nan_to_num()
        first = float(errors[:, 0].max())  # for lower ranks two shifts may be equally good
        if first > 1e-3:
            raise MethodError(
                "index",
                f"the turn of the best place differs by {first:.3g} rad from compare's, modulo "
                f"{period:.3g}",
            )
    return ""


def check_file(method: Method, rasters: Tensor, descriptors: Tensor) -> str:
    """Assert that the method survives being written to a file and read again.

    A network read from its file must give the same descriptors. Other methods are rebuilt from
    their fingerprint and must give the same scores. Returns why the check does not apply, or ''.
    """
    if isinstance(method, NetworkMethod):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.safetensors"
            write_network(path, TrainedNetwork(method, "", ""))
            network = read_network(path, type(method)).method
        error = _difference(network.describe(rasters), descriptors)
        if error > 0:
            raise MethodError(
                "file",
                f"read from a file, the network returns descriptors that differ by {error:.3g} of "
                "the largest number, expected 0",
            )
        return ""
    if not hasattr(type(method), "from_fingerprint"):
        return "the class has no from_fingerprint, so its exports can be scored in Python only"
    origin = json.loads(json.dumps(fingerprint(method)))
    copy = rebuild_method(origin, type(method))
    difference = first_difference(origin, fingerprint(copy))
    if difference is not None:
        key, before, after = difference
        raise MethodError(
            "file", f"rebuilt from its fingerprint, {key} is {after!r}, expected {before!r}"
        )
    error = _difference(
        copy.compare(descriptors, descriptors).score,
        method.compare(descriptors, descriptors).score,
    )
    if error > 0:
        raise MethodError(
            "file", f"rebuilt from its fingerprint, scores differ by {error:.3g}, expected 0"
        )
    return ""


def _turn_of(method: Method, query: Tensor, entry: Tensor) -> Tensor:
    turn = method.compare(query[None], entry[None]).turn
    assert turn is not None
    return turn[0]


def _away(angle: Tensor, period: float) -> Tensor:
    """Distance of angles from the nearest multiple of a period, radians."""
    return (torch.remainder(angle + period / 2, period) - period / 2).abs()


def _difference(first: Tensor, second: Tensor) -> float:
    """Largest difference relative to the largest number; infinite where the shapes differ."""
    if first.shape != second.shape:
        return math.inf
    return float((first - second).abs().max() / second.abs().max().clamp_min(1e-30))
