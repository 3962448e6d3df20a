"""The pose graph of a drive, optimised so that loops close, and wrong loops do not bend it."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.data.poses.trajectory import between
from deepring.data.spacing import path_lengths
from deepring.localization.drives.graph_noise import loop_covariance, odometry_covariances
from deepring.localization.drives.loop_graph import LoopGraph, Track

Poses = NDArray[np.float64]

#: Times that loops are weighed again by what was solved with those accepted.
_ROUNDS = 5
#: x, y, z, rotation vector -> GTSAM's order.
_ROTATION_FIRST = [3, 4, 5, 0, 1, 2]


@dataclass(frozen=True)
class PoseGraphSettings:
    """Settings of the optimisation."""

    confidence: float = 0.99
    """A loop counts as wrong where its error, against its covariance, is larger than that of so
    many right ones."""

    def __post_init__(self) -> None:
        checks.fraction("optimize.confidence", self.confidence)


class Optimized(NamedTuple):
    """What the optimisation gives."""

    poses: Poses
    """(n, 4, 4) of the keyframes; the first is where it was."""
    accepted: NDArray[np.bool_]
    """(loops,) whether each loop agrees with the others and the odometry."""


def optimize(graph: LoopGraph, settings: PoseGraphSettings | None = None) -> Optimized:
    """The poses of the keyframes that fit odometry and loops best, in SE(3).

    Graduated non-convexity with truncated least squares (Yang et al., RA-L 2020; GTSAM): it begins
    with all loops and leaves out those that do not fit. Odometry is not doubted, but for its
    breaks, where it says nothing. Without loops the poses stay.

    Raises ConfigError where gtsam is not installed.
    """
    settings = settings or PoseGraphSettings()
    library = gtsam()
    if not graph.loops:
        return Optimized(graph.poses.copy(), np.zeros(0, dtype=np.bool_))
    factors, start = _factors(library, graph)
    certain = factors.size() - len(graph.loops)
    optimizer = library.GncLMOptimizer(factors, start, _robust(library, certain))
    optimizer.setInlierCostThresholdsAtProbability(settings.confidence)
    values = optimizer.optimize()
    accepted = np.asarray(optimizer.getWeights())[certain:] > 0.5
    # The last of its steps begin where rejected loops had pulled; what is accepted is solved again.
    for _ in range(_ROUNDS):
        values = _solved(library, factors, accepted, (start, values))
        fitting = _fitting(factors, certain, values, settings.confidence)
        if (fitting == accepted).all():
            break
        accepted = fitting
    else:
        values = _solved(library, factors, accepted, (start, values))
    poses = np.stack([values.atPose3(k).matrix() for k in range(len(graph.poses))])
    return Optimized(poses, accepted)


def _robust(library: Any, certain: int) -> Any:
    """Settings of the graduated non-convexity, which doubts the factors behind the certain ones."""
    params = library.GncLMParams()
    params.setLossType(library.GncLossType.TLS)
    params.setKnownInliers(list(range(certain)))
    return params


def _solved(
    library: Any, factors: Any, accepted: NDArray[np.bool_], starts: tuple[Any, ...]
) -> Any:
    """The least squares of the factors with the accepted loops, from the better of the starts."""
    certain = factors.size() - len(accepted)
    chosen = library.NonlinearFactorGraph()
    for k in [*range(certain), *(certain + np.flatnonzero(accepted)).tolist()]:
        chosen.add(factors.at(k))
    results = [library.LevenbergMarquardtOptimizer(chosen, start).optimize() for start in starts]
    return min(results, key=chosen.error)


def _fitting(factors: Any, certain: int, values: Any, confidence: float) -> NDArray[np.bool_]:
    """Which loops fit the values: (loops,)."""
    from scipy.stats import chi2

    costs = [2 * factors.at(k).error(values) for k in range(certain, factors.size())]
    return np.array(costs) < chi2.ppf(confidence, 6)


def _factors(library: Any, graph: LoopGraph) -> tuple[Any, Any]:
    """The factors, loops last, and the values to start from."""
    factors, values = library.NonlinearFactorGraph(), library.Values()
    poses = [library.Pose3(pose) for pose in graph.poses]
    for k, pose in enumerate(poses):
        values.insert(k, pose)
    held = library.noiseModel.Isotropic.Sigma(6, 1e-4)
    factors.add(library.PriorFactorPose3(0, poses[0], held))

    def add(first: int, second: int, edge: Any, covariance: NDArray[np.float64]) -> None:
        noise = library.noiseModel.Gaussian.Covariance(
            covariance[np.ix_(_ROTATION_FIRST, _ROTATION_FIRST)]
        )
        factors.add(library.BetweenFactorPose3(first, second, edge, noise))

    for k, covariance in enumerate(odometry_covariances(graph)):
        add(k, k + 1, poses[k].between(poses[k + 1]), covariance)
    for loop in graph.loops:
        edge = library.Pose3(loop.transform)
        add(loop.earlier, loop.keyframe, edge, loop_covariance(loop))
    return factors, values


def corrected(track: Track, graph: LoopGraph, keyframes: Poses) -> Poses:
    """Poses (m, 4, 4) of all scans of a track, from the optimised ones of its keyframes.

    A scan between two keyframes keeps its pose relative to each of them; where these two disagree,
    it lies between by its share of the path. Beyond the first and last keyframe it moves along.
    """
    rows, poses = graph.scans, track.poses
    path = path_lengths(poses[:, :3, 3])
    after = np.clip(np.searchsorted(rows, np.arange(len(poses))), 1, max(len(rows) - 1, 1))
    if len(rows) == 1:
        return np.asarray(keyframes[0] @ np.linalg.inv(poses[rows[0]]) @ poses)
    before = after - 1
    start = keyframes[before] @ np.linalg.inv(poses[rows[before]]) @ poses
    end = keyframes[after] @ np.linalg.inv(poses[rows[after]]) @ poses
    length = path[rows[after]] - path[rows[before]]
    share = (path - path[rows[before]]) / np.where(length > 0, length, 1.0)
    share = np.clip(share, 0.0, 1.0)
    # A break is no motion to spread: scans before it belong to the keyframe before.
    share[np.isin(after, graph.breaks) & (np.arange(len(poses)) < rows[after])] = 0.0
    return between(start, end, share)


def gtsam() -> Any:
    """The library. Raises ConfigError if it is not installed."""
    return checks.installed("optimize", "gtsam", "gtsam", "optimize")
