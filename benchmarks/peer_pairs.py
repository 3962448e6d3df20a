"""One scan's pose in the frame of another: deepring beside kiss-matcher and small_gicp.

Each method gets the points of both scans, the query's turned at random, and nothing else. Its time
is the processor time from these points to the pose. Success is less than 2 m and 5° off.
"""

import importlib.util
import itertools
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from peer_table import Share
from poses import pairs

from deepring.core.rigid import (
    pose_from,
    rotation_from_rpy,
    turn_points,
    wrap_angle,
    yaw_after_turn,
    yaw_of,
)
from deepring.data.readers import ground_of, list_sessions, open_session
from deepring.localization.candidates import RerankSettings, align_candidates
from deepring.localization.registration.refinement import refine, start_of
from deepring.methods.deepring import DeepRing
from deepring.rasters import BevRaster

BINS = ((0, 5), (5, 10), (10, 12), (12, 20), (20, 35))

#: Sides of kiss-matcher's voxels, metres: its default for a single scan, and two coarser ones.
VOXELS = (0.3, 0.6, 1.0)

#: (place, query) -> pose (4, 4) place <- query.
Method = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class PairRow:
    """One method at one distance."""

    data: str
    metres: str
    method: str
    pairs: int
    success: Share
    median_m: float | None
    """Of those that succeed."""
    median_deg: float | None
    ms: float
    """Processor time of a pair, median."""


def measured_pairs(name: str, root: str, network: DeepRing, count: int) -> list[PairRow]:
    """Every method on the same pairs, of two sessions or of one with itself."""
    format = name.removeprefix("sim_")
    sessions = [open_session(format, root, one) for one in list_sessions(format, root)[:2]]
    first, second = sessions[0], sessions[-1]
    tried = methods(network, ground_of(first, format))
    rng, rows = np.random.default_rng(0), []
    warm = True
    for low, high in BINS:
        print(f"{name}: pairs {low} to {high} m apart", file=sys.stderr, flush=True)
        found: dict[str, list[tuple[float, float, float]]] = {method: [] for method in tried}
        for j, k in itertools.islice(pairs(first, second, low, high, rng), count):
            turn = float(rng.uniform(0, 2 * math.pi))
            relative = np.linalg.inv(first.poses[j]) @ turned_pose(second.poses[k], turn)
            place, query = first.points(j), turn_points(second.points(k), turn)
            for method, solve in tried.items():
                if warm:
                    solve(place, query)  # compiles
                started = time.process_time()
                pose = solve(place, query)
                seconds = time.process_time() - started
                found[method].append((*errors(pose, relative), seconds))
            warm = False
        rows += [
            _row(name, f"{low} to {high}", method, np.array(values))
            for method, values in found.items()
            if values
        ]
    return rows


def turned_pose(pose: np.ndarray, turn: float) -> np.ndarray:
    """Pose of the sensor that sees points turned by ``turn``."""
    yaw = yaw_after_turn(0.0, turn)
    return pose @ pose_from(rotation_from_rpy(0, 0, yaw), np.zeros(3))


def errors(pose: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Metres along x and y, and degrees of yaw."""
    off = wrap_angle(float(yaw_of(pose)) - float(yaw_of(truth)))
    return float(np.linalg.norm(pose[:2, 3] - truth[:2, 3])), abs(math.degrees(off))


def methods(network: DeepRing, ground_z: float) -> dict[str, Method]:
    """What is compared, as far as it is installed."""
    tried = dict(_deepring(network, ground_z))
    if importlib.util.find_spec("kiss_matcher"):
        tried |= {f"kiss-matcher, voxel {voxel:g} m": _kiss_matcher(voxel) for voxel in VOXELS}
    if importlib.util.find_spec("small_gicp"):
        tried["small_gicp from the identity"] = _small_gicp
    return tried


def _deepring(network: DeepRing, ground_z: float) -> Iterator[tuple[str, Method]]:
    raster, settings = BevRaster(), RerankSettings(candidates=1)

    def planar(place: np.ndarray, query: np.ndarray, turn_known: bool) -> tuple[float, np.ndarray]:
        images = [torch.from_numpy(raster(points, ground_z)) for points in (place, query)]
        turn = _descriptors_turn(network, ground_z, place, query) if turn_known else None
        found = align_candidates(images[1], turn, images[0][None], settings)
        return float(found.turn[0]), found.position[0].double().numpy()

    def around(place: np.ndarray, query: np.ndarray) -> np.ndarray:
        return start_of(*planar(place, query, turn_known=False))

    def described(place: np.ndarray, query: np.ndarray) -> np.ndarray:
        return start_of(*planar(place, query, turn_known=True))

    def refined(place: np.ndarray, query: np.ndarray) -> np.ndarray:
        return refine(query, place, *planar(place, query, turn_known=True)).transform

    yield "deepring, turns all around", around
    yield "deepring, the descriptors' turn", described
    if importlib.util.find_spec("small_gicp"):
        yield "deepring, the descriptors' turn, refined", refined


def _descriptors_turn(
    network: DeepRing, ground_z: float, place: np.ndarray, query: np.ndarray
) -> torch.Tensor:
    with torch.inference_mode():
        both = [torch.from_numpy(network.raster(points, ground_z)) for points in (place, query)]
        descriptors = network.describe(torch.stack(both))
        _, turn = network.compare(descriptors[1:], descriptors[:1])
    return turn[0]


def _kiss_matcher(voxel: float) -> Method:
    import kiss_matcher

    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=voxel))

    def solve(place: np.ndarray, query: np.ndarray) -> np.ndarray:
        matcher.reset()
        found = matcher.estimate(query, place)  # source, target
        return pose_from(np.asarray(found.rotation), np.asarray(found.translation).ravel())

    return solve


def _small_gicp(place: np.ndarray, query: np.ndarray) -> np.ndarray:
    import small_gicp

    target, source = place.astype(np.float64), query.astype(np.float64)
    return np.asarray(small_gicp.align(target, source).T_target_source)


def _row(data: str, metres: str, method: str, values: np.ndarray) -> PairRow:
    off, degrees, seconds = values.T
    good = (off < 2) & (degrees < 5)
    medians = [float(np.median(v[good])) if good.any() else None for v in (off, degrees)]
    shown = [None if m is None else round(m, 3) for m in medians]
    share = Share(int(good.sum()), len(good))
    return PairRow(
        data, metres, method, len(good), share, *shown, round(float(np.median(seconds)) * 1e3, 2)
    )
