"""Figures of one scan that tell a plausible scan from wrong numbers."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.returns import is_return

#: Points of a scan that are measured, drawn at random from more; figures vary by 1 %.
MOST_POINTS = 20_000
#: Metres. Returns beyond are not drawn in any image, and few sensors give many.
FIELD = 80.0
#: Metres. Farther than nearly all returns of any LiDAR on a vehicle.
REACH = 250.0
#: Sizes that no coordinate in any unit has, not even rounding errors of 0, but most numbers have
#: that are read with wrong types.
TINY, HUGE = 1e-20, 1e8


@dataclass(frozen=True)
class ScanFigures:
    """Figures of one scan, or their medians over several; NaN where a figure cannot be measured.

    Lengths are in the unit of the coordinates, which should be metres.
    """

    points: float
    """Records with a return."""
    missing: float
    """Share of the records without a return."""
    odd: float
    """Share of the coordinates that are tiny or huge."""
    distance: float
    """Median horizontal distance from the origin."""
    field: float
    """Share of the points within 80 m horizontally."""
    beyond: float
    """Share of the points beyond 250 m horizontally."""
    span_x: float
    """Of the middle 90 % of x; so also ``span_y`` and ``span_z``."""
    span_y: float
    span_z: float
    low: float
    """z below which 5 % of the points lie."""
    high: float
    """z above which 5 % of the points lie."""
    centre_x: float
    """Median of x."""
    centre_y: float
    whole: float
    """Share of the z values that are whole numbers."""
    mixed: float
    """Difference of the distributions of x and z, 0 (the same) to 1."""
    alternating: float
    """Difference of the distributions of x or y in every other record, 0 (the same) to 1."""
    ground: float
    """z of the ground around the origin."""
    ground_share: float
    """Share of the surroundings whose lowest points lie within 0.5 m of ``ground``."""


def measure_scan(records: NDArray[np.floating]) -> ScanFigures:
    """Measure the records (n, 3) of a scan, missing returns included. n may be 0."""
    with np.errstate(invalid="ignore", over="ignore"):  # of wrong types
        return _measure(np.asarray(records, dtype=np.float64))


def _measure(values: NDArray[np.float64]) -> ScanFigures:
    valid = values[is_return(values)]
    count = len(valid)
    missing = 1 - count / len(values) if len(values) else np.nan
    if not count:
        return ScanFigures(*np.array([0.0, missing, *[np.nan] * 15, 0.0]).tolist())
    points = valid
    if count > MOST_POINTS:
        points = valid[np.random.default_rng(0).choice(count, MOST_POINTS, replace=False)]
    sizes = np.abs(points)
    distance = np.hypot(points[:, 0], points[:, 1])
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    centre = np.median(points, axis=0)
    ground, share = measure_ground(points)
    return ScanFigures(
        points=float(count),
        missing=missing,
        odd=float(np.mean(((sizes > 0) & (sizes < TINY)) | (sizes > HUGE))),
        distance=float(np.median(distance)),
        field=float(np.mean(distance < FIELD)),
        beyond=float(np.mean(distance > REACH)),
        span_x=float(high[0] - low[0]),
        span_y=float(high[1] - low[1]),
        span_z=float(high[2] - low[2]),
        low=float(low[2]),
        high=float(high[2]),
        centre_x=float(centre[0]),
        centre_y=float(centre[1]),
        whole=float(np.mean(points[:, 2] == np.rint(points[:, 2]))),
        mixed=_difference(points[:, 0], points[:, 2]),
        alternating=_alternating(values[:MOST_POINTS]),
        ground=ground,
        ground_share=share,
    )


def median_figures(figures: Sequence[ScanFigures]) -> ScanFigures:
    """The median of each figure; the ground over the scans that show it. At least one scan."""
    table = np.array([astuple(one) for one in figures])
    medians = [
        float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else np.nan
        for column in table.T
    ]
    return ScanFigures(*medians)


#: Metres. The ground is looked for in this ring around the sensor: an NCLT scan shows it beyond
#: 6 m, and slopes carry it away beyond 25 m.
GROUND_RING = (2.0, 25.0)
#: Metres. Each cell of the ring gives its lowest points, which are the ground in most cells.
GROUND_CELL = 2.5
#: Metres. Cells whose lowest points lie so near their median agree.
GROUND_BAND = 0.5
#: Cells, and points in each, below which nothing can be said.
LEAST_CELLS, LEAST_IN_CELL = 12, 3


def measure_ground(points: NDArray[np.float64]) -> tuple[float, float]:
    """z of the ground around the origin, and the share of the surroundings that agree with it.

    The median of the lowest points (5 %) of cells of 2.5 m, from 2 to 25 m around the sensor; NaN
    and 0 with too few cells. Tilt and slope cancel out around the sensor.
    """
    distance = np.hypot(points[:, 0], points[:, 1])
    near = points[(distance > GROUND_RING[0]) & (distance < GROUND_RING[1])]
    cells = np.floor(near[:, :2] / GROUND_CELL).astype(np.int64)
    keys = cells[:, 0] * 1000 + cells[:, 1]
    order = np.lexsort((near[:, 2], keys))
    starts = np.flatnonzero(np.diff(keys[order], prepend=-(10**9)))
    counts = np.diff(starts, append=len(order))
    lowest = near[order, 2][starts + (counts * 0.05).astype(np.int64)][counts >= LEAST_IN_CELL]
    if len(lowest) < LEAST_CELLS:
        return np.nan, 0.0
    ground = float(np.median(lowest))
    return ground, float(np.mean(np.abs(lowest - ground) < GROUND_BAND))


def _alternating(records: NDArray[np.float64]) -> float:
    """Greatest difference of x or y between even and odd records; both must have returns."""
    returns = is_return(records)
    even, odd = records[::2][returns[::2]], records[1::2][returns[1::2]]
    if not len(even) or not len(odd):
        return np.nan
    return max(_difference(even[:, axis], odd[:, axis]) for axis in (0, 1))


def _difference(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """The two-sample Kolmogorov-Smirnov statistic."""
    one, other = np.sort(one), np.sort(other)
    both = np.concatenate([one, other])
    shares = [np.searchsorted(a, both, side="right") / len(a) for a in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())
