"""Whether a cloud can be one of an area, in metres with z up; see `expect_plausible`."""

import numpy as np
from numpy.typing import NDArray

from deepring.data.clouds.tiles import TiledCloud
from deepring.errors import DataError

#: Median distance of a point to the next one, metres: 0.1 to 1 in clouds of streets and in those
#: from the air. Millimetres and centimetres give ten times more.
FARTHEST_APART = 3.0
#: Metres from the lowest to the highest 1 % along x and y; less is no area, but another unit.
SMALLEST = 5.0
#: Cells of 2 m that are occupied, as seen along an axis: most as seen from above. 1.5 times as many
#: along another axis: that one points up.
MORE_CELLS = 1.5
#: Steps between neighbouring cells of the lowest points against those of the highest: 0.3 to 0.8
#: where z points up, since the ground is smoother than roofs and trees.
ROUGHER = 1.5

_SAMPLE = 1 << 20
_CELL = 2.0
_LARGEST_STEP = 5.0


def spacing_of(points: NDArray[np.floating]) -> float:
    """Median distance (metres) of points (n, 3) to the nearest other one; infinite for one point.

    At most 20 000 of them are asked.
    """
    from scipy.spatial import KDTree

    if len(points) < 2:
        return float("inf")
    asked = points[:: max(1, len(points) // 20_000)]
    distances = KDTree(points).query(asked, k=2)[0][:, 1]
    return float(np.median(distances))


def cloud_spacing(cloud: TiledCloud) -> float:
    """Median of `spacing_of` over tiles, each as often as it has points; metres."""
    spacings, sizes = [], []
    for k in _some_tiles(cloud, 24):
        points = cloud.points_of(k)
        if len(points) > 1:
            spacings.append(spacing_of(points))
            sizes.append(len(points))
    if not spacings:
        return float("inf")
    order = np.argsort(spacings)
    share = np.cumsum(np.array(sizes)[order]) / sum(sizes)
    return float(np.array(spacings)[order][np.searchsorted(share, 0.5)])


def expect_unit(source: str, points: NDArray[np.float64]) -> None:
    """Raise DataError for points (n, 3), the first of a cloud, in millimetres or centimetres.

    A cloud in a random order may be sparse in its first points, but is not high.
    """
    apart = spacing_of(points)
    low, high = np.quantile(points[:, 2], [0.01, 0.99])
    if apart > FARTHEST_APART and high - low > 300:
        raise _wrong_unit(source, points, f"points are {apart:.3g} m apart")


def expect_plausible(cloud: TiledCloud) -> float:
    """The cloud's spacing, see `cloud_spacing`.

    Raises DataError for a cloud in another unit, or one in which z does not point up.
    """
    sample = _sample(cloud)
    apart = cloud_spacing(cloud)
    if apart > FARTHEST_APART:
        raise _wrong_unit(cloud.source, sample, f"points are {apart:.3g} m apart")
    size = np.diff(np.quantile(sample, [0.01, 0.99], axis=0), axis=0)[0]
    if size[:2].max() < SMALLEST:
        raise _wrong_unit(
            cloud.source, sample, f"all lie within {size[0]:.2g} x {size[1]:.2g} m, no area"
        )
    seen = [len(np.unique(_cells(sample, axis), axis=0)) for axis in range(3)]
    axis = int(np.argmax(seen))
    if seen[axis] > MORE_CELLS * seen[2]:
        raise DataError(
            f"cloud {cloud.source}: {'xyz'[axis]} seems to be vertical ({_extent(sample)}; seen "
            f"along it the cloud covers {seen[axis] / seen[2]:.1f} times the area that it covers "
            "along z); expected z up: turn the cloud"
        )
    lowest, highest = _roughness(sample, sign=1), _roughness(sample, sign=-1)
    if lowest > ROUGHER * highest:
        raise DataError(
            f"cloud {cloud.source}: z seems to point down: its highest points are as smooth as a "
            f"ground, and the lowest are not (steps of {highest:.2f} and {lowest:.2f} m on 2 m); "
            "expected z up: turn the cloud"
        )
    return apart


def _wrong_unit(source: str, points: NDArray[np.floating], what: str) -> DataError:
    return DataError(
        f"cloud {source}: {what} ({_extent(points)}); expected an area in metres: check the unit"
    )


def _extent(points: NDArray[np.floating]) -> str:
    ends = zip("xyz", points.min(axis=0), points.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.6g} to {high:.6g}" for axis, low, high in ends)


def _some_tiles(cloud: TiledCloud, most: int) -> list[int]:
    count = len(cloud.tiles)
    return sorted(set(np.linspace(0, count - 1, min(most, count)).astype(int).tolist()))


def _sample(cloud: TiledCloud) -> NDArray[np.float64]:
    """Some points (n, 3) of a cloud, whole tiles, metres in its coordinates."""
    tiles = _some_tiles(cloud, 100)
    parts = []
    for k in tiles:
        points = cloud.points_of(k)
        step = max(1, len(points) * len(tiles) // _SAMPLE)
        parts.append(points[::step].astype(np.float64) + cloud.tiles[k].corner)
    return np.concatenate(parts)


def _cells(points: NDArray[np.float64], axis: int) -> NDArray[np.int64]:
    """Cells (n, 2) of points as seen along an axis."""
    return np.floor(np.delete(points, axis, axis=1) / _CELL).astype(np.int64)


def _roughness(points: NDArray[np.float64], sign: int) -> float:
    """Mean step in metres between the lowest points (``sign`` 1) or highest (-1) of neighbours."""
    cells = _cells(points, 2)
    order = np.lexsort((sign * points[:, 2], cells[:, 1], cells[:, 0]))
    cells, z = cells[order], points[order, 2]
    first = np.any(np.diff(cells, axis=0, prepend=cells[:1] - 1), axis=1)
    cells, z = cells[first], z[first]
    beside = (np.diff(cells, axis=0) == [0, 1]).all(axis=1)
    steps = np.minimum(np.abs(np.diff(z)), _LARGEST_STEP)[beside]
    return float(steps.mean()) if len(steps) else 0.0
