"""Where a sensor could stand in a cloud: on ground that was seen, with free space above it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.data.clouds.tiles import TiledCloud
from deepring.progress import Progress

#: Side of a cell, metres, where the cloud is dense; else as many of the cloud's spacings.
CELL, SPACINGS = 1.0, 3.0
#: Rise between neighbouring cells of a level surface, per metre: ramps and steep streets have 0.2.
STEEPEST = 0.35
#: Neighbours, of eight, at the height of a cell of level ground.
LEVEL = 4
#: Metres above the ground of a cell that are free of points, from and, above the sensor, to.
KERB, ABOVE = 0.5, 0.3
#: Cells of level ground within a square of 7 x 7 around a place.
AROUND = 16
#: Drop from a surface to the ground outside of it, metres: a roof's is more, on most sides.
ROOF = 1.5
#: Metres around the ground that is looked at, so that what stands there counts.
_HALO = 20.0
#: Metres of ground that are looked at together.
_BLOCK = 200.0


@dataclass(frozen=True)
class GroundGrid:
    """Ground in square cells."""

    low: NDArray[np.float64]
    """(2,) x and y at which the first cell begins, metres."""
    cell: float
    """Side, metres."""
    height: NDArray[np.float64]
    """(n, m) metres; NaN where no ground was seen."""
    stands: NDArray[np.bool_]
    """(n, m) where a sensor could stand."""


def standing_places(
    cloud: TiledCloud,
    height: float,
    spacing: float,
    apart: float,
    progress: Progress | None = None,
) -> NDArray[np.float64]:
    """Positions (k, 3) on the ground, at most one in each square of a grid.

    In a square, the cell next to its middle is taken where a sensor can stand; see `ground_grid`.

    Args:
        cloud: the cloud.
        height: of the sensor above the ground, metres.
        spacing: side of a square, metres.
        apart: the cloud's spacing, metres.
        progress: called with the numbers of blocks done and of all.
    """
    squares = max(1, round(_BLOCK / spacing))
    side = squares * spacing
    corners = list(_blocks(cloud, side))
    found = [np.empty((0, 3))]
    for done, corner in enumerate(corners, start=1):
        grid = ground_grid(cloud, corner, corner + side, height, apart)
        found.append(_one_per_square(grid, corner, spacing, squares))
        if progress is not None:
            progress(done, len(corners))
    return np.concatenate(found)


def ground_grid(
    cloud: TiledCloud,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    height: float,
    apart: float,
) -> GroundGrid:
    """Where a sensor ``height`` above the ground could stand within a rectangle.

    The ground is the lowest surface of each cell. A sensor can stand on it where it is level, there
    is more of it around, no points are between the kerb and above the sensor, and it is no roof:
    a surface that ends, on most of its sides, above the ground around. ``apart`` is the cloud's
    spacing, metres.
    """
    cell = max(CELL, SPACINGS * apart)
    start = np.floor((low - _HALO) / cell) * cell
    shape = tuple(int(n) for n in np.ceil((high + _HALO - start) / cell))
    origin = np.array([*start, cloud.tiles[0].corner[2]])
    points = cloud.within(start, start + np.array(shape) * cell, origin)
    cells = np.floor(points[:, :2] / cell).astype(np.int64)
    flat = (cells[:, 0].clip(0, shape[0] - 1)) * shape[1] + cells[:, 1].clip(0, shape[1] - 1)
    surface = _lowest_surface(flat, points[:, 2], shape, 2 * apart)
    level = _level(surface, STEEPEST * cell)
    free = _free(flat, points[:, 2], surface, height)
    surface[~level] = np.nan
    ground = level & ~_roofs(surface, STEEPEST * cell)
    stands = ground & free & (_count(ground, 7) >= AROUND)
    return GroundGrid(start, cell, surface + origin[2], stands)


def _blocks(cloud: TiledCloud, side: float) -> Iterator[NDArray[np.float64]]:
    """Lowest corners (2,) of the blocks in which there are tiles, in rows that turn."""
    keys = set()
    for tile in cloud.tiles:
        first = np.floor(tile.corner[:2] / side).astype(int)
        last = np.ceil((tile.corner[:2] + tile.size) / side).astype(int)
        keys |= {(i, j) for i in range(first[0], last[0]) for j in range(first[1], last[1])}
    for i, j in sorted(keys, key=lambda key: (key[0], key[1] if key[0] % 2 else -key[1])):
        yield np.array([i * side, j * side])


def _one_per_square(
    grid: GroundGrid, corner: NDArray[np.float64], spacing: float, squares: int
) -> NDArray[np.float64]:
    """The cell that stands and is next to the middle of each square, (k, 3)."""
    rows = np.argwhere(grid.stands)
    middles = grid.low + (rows + 0.5) * grid.cell
    square = np.floor((middles - corner) / spacing).astype(np.int64)
    inside = ((square >= 0) & (square < squares)).all(axis=1)
    rows, middles, square = rows[inside], middles[inside], square[inside]
    away = np.linalg.norm(middles - corner - (square + 0.5) * spacing, axis=1)
    key = square[:, 0] * squares + square[:, 1]
    order = np.lexsort((away, key))
    first = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
    return np.column_stack([middles[first], grid.height[tuple(rows[first].T)]])


def _lowest_surface(
    flat: NDArray[np.int64], z: NDArray[np.float32], shape: tuple[int, ...], near: float
) -> NDArray[np.float64]:
    """Height of the lowest point of each cell that has another one above it, near by; else NaN.

    Single points below the ground are echoes of what mirrors.
    """
    surface = np.full(shape[0] * shape[1], np.nan)
    order = np.lexsort((z, flat))
    flat, z = flat[order], z[order]
    backed = (flat[1:] == flat[:-1]) & (z[1:] - z[:-1] < max(0.3, near))
    cells, heights = flat[:-1][backed], z[:-1][backed]
    cells, first = np.unique(cells, return_index=True)
    surface[cells] = heights[first]
    return surface.reshape(shape)


def _level(surface: NDArray[np.float64], step: float) -> NDArray[np.bool_]:
    """Cells of which `LEVEL` neighbours are at most ``step`` (diagonally more) higher or lower."""
    padded = np.pad(surface, 1, constant_values=np.nan)
    count = np.zeros(surface.shape, dtype=np.int64)
    n, m = surface.shape
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            if i or j:
                beside = padded[1 + i : 1 + i + n, 1 + j : 1 + j + m]
                count += np.abs(beside - surface) <= step * np.hypot(i, j)
    return np.asarray(count >= LEVEL)


def _free(
    flat: NDArray[np.int64], z: NDArray[np.float32], surface: NDArray[np.float64], height: float
) -> NDArray[np.bool_]:
    """Cells without more than a stray point between the kerb and above the sensor."""
    above = z - surface.reshape(-1)[flat]
    between = flat[(above > KERB) & (above < height + ABOVE)]
    return np.bincount(between, minlength=surface.size).reshape(surface.shape) <= 1


def _count(mask: NDArray[np.bool_], side: int) -> NDArray[np.int64]:
    """Cells of the mask in the square of ``side`` around each cell."""
    from scipy.ndimage import uniform_filter

    share = uniform_filter(mask.astype(np.float64), side, mode="constant")
    return np.rint(share * side**2).astype(np.int64)


def _roofs(surface: NDArray[np.float64], step: float) -> NDArray[np.bool_]:
    """Cells of connected surfaces that end above other ones on most of their sides."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n = surface.size
    index = np.arange(n).reshape(surface.shape)
    pairs = []
    for away in (1, 2, 3):
        pairs.append((index[away:, :].ravel(), index[:-away, :].ravel(), away))
        pairs.append((index[:, away:].ravel(), index[:, :-away].ravel(), away))
    z = surface.ravel()
    joined = [(a, b) for a, b, away in pairs if away == 1]
    a = np.concatenate([a for a, _ in joined])
    b = np.concatenate([b for _, b in joined])
    with np.errstate(invalid="ignore"):
        near = np.abs(z[a] - z[b]) <= step
    graph = coo_matrix((np.ones(near.sum()), (a[near], b[near])), shape=(n, n))
    label = connected_components(graph, directed=False)[1]
    sides, drops = np.zeros(n), np.zeros(n)
    for a, b, _ in pairs:
        with np.errstate(invalid="ignore"):
            across = np.isfinite(z[a]) & np.isfinite(z[b]) & (label[a] != label[b])
        for one, other in ((a[across], b[across]), (b[across], a[across])):
            np.add.at(sides, label[one], 1)
            np.add.at(drops, label[one], z[one] - z[other] > ROOF)
    roof = (drops > 0.5 * sides) & (sides > 0)
    return np.asarray(roof[label].reshape(surface.shape))
