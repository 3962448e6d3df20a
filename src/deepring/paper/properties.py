"""What a method bears, tells and costs, as measured on scans and their moved twins."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from deepring.errors import ConfigError, DataError
from deepring.methods.method import Method
from deepring.paper.moved_scans import (
    Motion,
    MovedScores,
    Scan,
    SectorTurn,
    column_indices,
    image_of,
    moved_scores,
    other_places,
)
from deepring.rasters import Raster

#: Lengths of the shifts, metres.
SHIFTS_M = (1.0, 5.0, 10.0)

#: Turns by whole sectors and by any angle, of each scan.
TURNS = 3

#: A motion is borne exactly where it costs at most this share: a few of a scan's points may change
#: their cells by rounding.
EXACT = 0.001

#: The step by which an image from above turns onto itself, degrees.
_QUARTER = 90.0

#: Comparisons that are timed, and the seconds that they may take beside the first.
_RUNS, _RUNS_S = 10, 1.0

#: The shift between two scans whose relative pose is asked for, metres.
_POSE_SHIFT = 2.0


@dataclass(frozen=True)
class Properties:
    """Of one method. Losses are shares of what separates a scan from another place.

    A loss is 0 where the moved scan scores as the scan itself, and 1 where it scores as an
    unrelated scan; NaN where the method does not tell unrelated scans apart.
    """

    method: str
    n: int
    """Scans."""
    sector_deg: float | None
    """The step by which the method's raster turns onto itself; None where there is none."""
    sectors: float | None
    """Loss after turns by whole such steps."""
    any_turn: float
    half_turn: float
    shifts: tuple[float, ...]
    """Losses, as `SHIFTS_M`."""
    same: bool
    """Whether the descriptor itself stays: under whole sectors, or under any turn without them."""
    numbers: int
    """In a descriptor."""
    bytes: int
    turn_error_deg: float | None
    """Median error of the turn that it tells, for turns by any angle; None if it tells none."""
    turn_period_deg: float
    pose_error: tuple[float, float] | None
    """Median errors of the relative poses that it tells, metres and degrees; None if the method
    tells none, NaN if it told none of these scans."""
    parameters: int
    scan_ms: float
    """From points to the descriptor, one at a time: the quickest of the scans."""
    pair_ms: float
    """For `compare`, all pairs of the scans at once: the quickest run."""


def properties_of(
    name: str,
    method: Method,
    scans: Sequence[Scan],
    ground_z: float,
    columns: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Properties:
    """Measure a method on scans of several places.

    The arguments are those of `deepring.paper.moved_scans.moved_scores`; ``name`` is the method's.

    Raises:
        DataError: no two scans of different places, or points without a column that it needs.
    """
    rng = np.random.default_rng(seed)
    if not other_places([scan.place for scan in scans], rng):
        raise DataError(
            "scans: all of one place, expected some farther apart than 140 m, or several files"
        )
    sector = sector_of(method)
    motions = [_motions(rng, method) for _ in scans]
    moves = [(each.itself, each.twins) for each in motions]
    scores = moved_scores(method, scans, moves, ground_z, columns, seed, progress)
    losses = scores.lost.mean(axis=0)
    whole, free, half, shifts = np.split(losses, [TURNS, 2 * TURNS, 2 * TURNS + 1])
    turned = slice(0, TURNS) if sector else slice(TURNS, 2 * TURNS)
    return Properties(
        name,
        len(scans),
        sector,
        float(whole.mean()) if sector else None,
        float(free.mean()),
        float(half[0]),
        tuple(map(float, shifts)),
        bool(losses[turned].mean() <= EXACT >= np.median(scores.changes[:, turned])),
        scores.descriptors[0].numel(),
        scores.descriptors[0].nbytes,
        _turn_error(method, scores, motions),
        math.degrees(_period(method)),
        _pose_error(method, scans, motions, ground_z, columns),
        _parameters(method),
        1e3 * scores.seconds,
        1e3 * _pair_seconds(method, scores),
    )


def sector_of(method: Method) -> float | None:
    """The step by which the method's raster turns onto itself, degrees; None where there is none.

    >>> from deepring.methods.scan_context import ScanContext
    >>> from deepring.methods.ring import Ring
    >>> sector_of(ScanContext()), sector_of(Ring())
    (6.0, 90.0)
    """
    try:
        return 360 / method.raster.sectors
    except ConfigError:  # it has no azimuth
        return _QUARTER if {"x", "y"} <= set(method.raster.axes) else None


class _Motions(NamedTuple):
    """Of one scan."""

    itself: Motion
    sectors: Sequence[SectorTurn | Motion]
    free: Sequence[Motion]
    half: Motion
    shifts: Sequence[Motion]

    @property
    def twins(self) -> list[Motion | SectorTurn]:
        """Those of the twins, in order."""
        return [*self.sectors, *self.free, self.half, *self.shifts]


def _motions(rng: np.random.Generator, method: Method) -> _Motions:
    """A random heading; from it turns by sectors, by any angle, and by half; then shifts."""
    heading, towards = rng.uniform(0, 360), rng.uniform(0, 2 * math.pi)
    sector = sector_of(method) or _QUARTER
    steps = [int(rng.integers(1, round(360 / sector))) for _ in range(TURNS)]
    exactly = _turns_itself(method.raster)
    return _Motions(
        Motion(heading),
        [SectorTurn(k) if exactly else Motion(heading + k * sector) for k in steps],
        [Motion(heading + turn) for turn in rng.uniform(0, 360, TURNS)],
        Motion(heading + 180.0),
        [Motion(heading, (m * math.cos(towards), m * math.sin(towards))) for m in SHIFTS_M],
    )


def _turns_itself(raster: Raster) -> bool:
    """Whether an array of the raster can be turned without its scan."""
    if raster.axes[-2:-1] != ("theta",) and type(raster).turned is Raster.turned:
        return False
    blank = torch.from_numpy(np.zeros((1, *raster.shape), raster.dtype))
    try:
        raster.turned(blank, torch.tensor([1]))
    except ConfigError:
        return False
    return True


def _period(method: Method) -> float:
    return float(getattr(method, "turn_period", 2 * math.pi))


def _turn_error(method: Method, scores: MovedScores, motions: Sequence[_Motions]) -> float | None:
    """Median error of the turns told for turns by any angle, degrees."""
    if scores.turns is None:
        return None
    free = slice(TURNS, 2 * TURNS)
    true = [[m.yaw_deg - each.itself.yaw_deg for m in each.free] for each in motions]
    away = scores.turns[:, free] - np.radians(true)
    period = _period(method)
    away = (away + period / 2) % period - period / 2
    return _median(np.degrees(np.abs(away)))


def _pose_error(
    method: Method,
    scans: Sequence[Scan],
    motions: Sequence[_Motions],
    ground_z: float,
    columns: Sequence[str],
) -> tuple[float, float] | None:
    """Median errors of the pose between each scan and a twin that is turned and shifted."""
    relative_poses = getattr(method, "relative_poses", None)
    if relative_poses is None:
        return None
    taken = [0, 1, 2, *(3 + k for k in column_indices(method, columns))]
    errors = []
    for scan, each in zip(scans, motions, strict=True):
        still, turn = each.itself, each.free[0].yaw_deg - each.itself.yaw_deg
        shift = (_POSE_SHIFT * math.cos(turn), _POSE_SHIFT * math.sin(turn))
        points = np.ascontiguousarray(scan.points[:, taken])
        twin = Motion(still.yaw_deg + turn, shift)
        place, query = (image_of(method, motion(points), ground_z) for motion in (still, twin))
        errors.append(_apart(relative_poses(query, place[None])[0].numpy(), turn, shift))
    metres, degrees = np.transpose(errors)
    return _median(metres), _median(degrees)


def _median(values: ArrayLike) -> float:
    """The median of what is told; NaN where nothing is."""
    told = np.asarray(values)[np.isfinite(values)]
    return float(np.median(told)) if len(told) else math.nan


def _apart(
    pose: NDArray[np.float64], turn: float, shift: tuple[float, float]
) -> tuple[float, float]:
    """Metres and degrees between a pose and that of a turn and a shift in the plane."""
    found = math.degrees(math.atan2(pose[1, 0], pose[0, 0]))
    away = (found - turn + 180) % 360 - 180
    return float(np.hypot(*(pose[:2, 3] - shift))), abs(away)


def _parameters(method: Method) -> int:
    """Weights of a network; 0 of a method that learns nothing."""
    if not isinstance(method, torch.nn.Module):
        return 0
    return sum(parameter.numel() for parameter in method.parameters())


def _pair_seconds(method: Method, scores: MovedScores) -> float:
    """Seconds a pair, the quickest of some runs: the first may compile, others may be held up."""
    took: list[float] = []
    while len(took) < _RUNS and sum(took[1:]) < _RUNS_S:
        begun = time.perf_counter()
        method.compare(scores.descriptors, scores.descriptors)
        took.append(time.perf_counter() - begun)
    return min(took) / len(scores.descriptors) ** 2
