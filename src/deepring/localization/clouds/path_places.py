"""Places along a path through a cloud: where it was driven, on the ground of the cloud."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.data.clouds.tiles import TiledCloud
from deepring.data.spacing import sample_by_distance
from deepring.errors import DataError
from deepring.progress import Progress

#: Metres around a pose in which its ground is looked for.
_AROUND = 3.0
#: Metres below and above a pose between which its ground is: poses are those of a sensor up to so
#: high, or of a vehicle's origin on the ground.
_BELOW, _ABOVE = 5.0, 0.75
#: Step in which heights are counted, metres.
_STEP = 0.2
#: Cells of 0.5 m that show the ground beneath a pose, and their share of the best height's.
_LEAST, _SHARE = 4, 0.6
#: Metres from a pose within which its ground has to show at least one point.
_BENEATH = 1.5
#: Share of the places of a path that may lie without ground beneath.
MOST_OFF = 0.2


@dataclass(frozen=True)
class PathPlaces:
    """Places on a path."""

    rows: NDArray[np.int64]
    """(k,) the poses of the path that are places."""
    positions: NDArray[np.float64]
    """(k, 3) metres, on the ground beneath them."""
    off: int
    """Further places of the path that have no ground beneath, and are left out."""


def path_places(
    cloud: TiledCloud,
    path: NDArray[np.float64],
    spacing: float,
    progress: Progress | None = None,
) -> PathPlaces:
    """Places every ``spacing`` metres of a path (n, 3), metres in the cloud's coordinates.

    Where the path returns to less than half of that from a place, none is added. Raises DataError
    for a path of which more than `MOST_OFF` has no ground of the cloud beneath.
    """
    rows = sample_by_distance(path[:, :2], spacing, np.ones(len(path), dtype=np.bool_))
    rows = _apart(path, rows, spacing / 2)
    heights = np.empty(len(rows))
    for k, row in enumerate(rows.tolist()):
        heights[k] = ground_beneath(cloud, path[row])
        if progress is not None:
            progress(k + 1, len(rows))
    found = np.isfinite(heights)
    off = int((~found).sum())
    if off > MOST_OFF * len(rows):
        raise DataError(_off(cloud, path[rows], found))
    positions = np.column_stack([path[rows, :2], heights])[found]
    return PathPlaces(rows[found], positions, off)


def ground_beneath(cloud: TiledCloud, position: NDArray[np.float64]) -> float:
    """z of the ground beneath a position (3,), metres; NaN where none is seen.

    It is the highest surface between 5 m below and 0.75 m above the position which shows at least
    0.6 times as many cells as any other: of a bridge the roadway, not the street below.
    """
    low, high = position[:2] - _AROUND, position[:2] + _AROUND
    points = cloud.within(low, high, position)
    z = points[:, 2]
    points = points[(z > -_BELOW) & (z < _ABOVE)]
    if not len(points):
        return float("nan")
    rows = np.floor(points / [0.5, 0.5, _STEP]).astype(np.int64)
    rows = np.unique(rows, axis=0)
    lowest = math.floor(-_BELOW / _STEP)
    count = np.bincount(rows[:, 2] - lowest, minlength=math.ceil((_BELOW + _ABOVE) / _STEP))
    count = count + np.append(count[1:], 0)  # a surface may lie on the border of two steps
    if count.max() < _LEAST:
        return float("nan")
    step = int(np.flatnonzero(count >= _SHARE * count.max())[-1]) + lowest
    surface = points[(points[:, 2] >= step * _STEP) & (points[:, 2] < (step + 2) * _STEP)]
    if not (np.hypot(surface[:, 0], surface[:, 1]) < _BENEATH).any():
        return float("nan")  # walls aside, with nothing between them
    return float(np.median(surface[:, 2]) + position[2])


def _apart(path: NDArray[np.float64], rows: NDArray[np.int64], least: float) -> NDArray[np.int64]:
    """The rows that are at least so far from those before them."""
    from scipy.spatial import KDTree

    if least <= 0 or not len(rows):
        return rows
    kept = np.ones(len(rows), dtype=np.bool_)
    tree = KDTree(path[rows])
    for k, near in enumerate(tree.query_ball_point(path[rows], least)):
        kept[k] = not any(other < k and kept[other] for other in near)
    return rows[kept]


def _off(cloud: TiledCloud, path: NDArray[np.float64], found: NDArray[np.bool_]) -> str:
    """Why a path does not lie in the cloud."""
    off = int((~found).sum())
    text = f"path: {off} of {len(path)} places have no ground of the cloud beneath"
    inside = ((path[:, :2] >= cloud.low) & (path[:, :2] <= cloud.high)).all(axis=1)
    if inside.mean() < 0.8:
        return (
            f"{text}, {int((~inside).sum())} lie beside it: path {_ends(path[:, :2])}, cloud "
            f"{_ends(np.array([cloud.low, cloud.high]))}; expected poses in the cloud's coordinates"
        )
    below = [_height_at(cloud, position) for position in path[~found]]
    known = np.array([z for z in below if np.isfinite(z)])
    if len(known) and abs(float(np.median(path[~found, 2])) - float(np.median(known))) < _BELOW:
        return (
            f"{text}: the points there show no level surface; expected poses in the cloud's "
            "coordinates, and a cloud with its ground"
        )
    if len(known):
        apart = float(np.median(path[~found, 2])) - float(np.median(known))
        return (
            f"{text}: they are {abs(apart):.1f} m {'above' if apart > 0 else 'below'} the lowest "
            f"points there (median); expected the sensor's poses, up to {_BELOW:g} m above the "
            "ground, in the cloud's coordinates"
        )
    return f"{text}: no points are near; expected poses in the cloud's coordinates"


def _height_at(cloud: TiledCloud, position: NDArray[np.float64]) -> float:
    """z of the lowest points around a position, whatever its height; NaN without points."""
    points = cloud.within(position[:2] - _AROUND, position[:2] + _AROUND, position)
    return float(np.quantile(points[:, 2], 0.1) + position[2]) if len(points) else float("nan")


def _ends(points: NDArray[np.float64]) -> str:
    low, high = points.min(axis=0), points.max(axis=0)
    return f"x {low[0]:.0f} to {high[0]:.0f}, y {low[1]:.0f} to {high[1]:.0f} m"
