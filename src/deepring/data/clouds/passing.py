"""Points of what passed while a cloud was recorded: they stand on ground that was seen.

A car that drives through many scans leaves a row of cars in their fused cloud, and would hide what
is behind it from every virtual scan. Where it stood, the ground has been seen at other times: no
cell of ground is missing below it. Below a parked car, a wall or a hedge cells are missing.
"""

import numpy as np
from numpy.typing import NDArray

#: Side of a cell, metres.
CELL = 0.5
#: Metres above the ground between which points can be those of what passed: lorries and buses are
#: up to 4 m high, and ground rises and has grass.
LOWEST, HIGHEST = 0.4, 4.0
#: Metres above the lowest point near by, within which a point is one of the ground.
GROUND = 0.3
#: Cells, along each axis, in which the lowest point is looked for.
WINDOW = 5
#: Cells of 3 x 3 in which the ground has to be seen.
SEEN = 8


def without_passing(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The points (n, 3), metres, z up, without those of what passed.

    Things lower than `HIGHEST` that stand on seen ground are left out with them, such as posts.
    """
    from scipy.ndimage import minimum_filter, uniform_filter

    if not len(points):
        return points
    cells = np.floor(points[:, :2] / np.float32(CELL)).astype(np.int64)
    cells -= cells.min(axis=0)
    shape = tuple(cells.max(axis=0) + 1)
    flat = cells[:, 0] * shape[1] + cells[:, 1]
    lowest = np.full(shape, np.inf, dtype=np.float32)
    np.minimum.at(lowest.reshape(-1), flat, points[:, 2])
    floor = minimum_filter(lowest, WINDOW, mode="nearest").reshape(-1)
    height = points[:, 2] - floor[flat]
    seen = np.zeros(shape, dtype=np.float32)
    seen.reshape(-1)[flat[height < GROUND]] = 1.0
    around = 9 * uniform_filter(seen, 3, mode="nearest")
    whole = ((seen > 0) & (around > SEEN - 0.5)).reshape(-1)
    passing = whole[flat] & (height > LOWEST) & (height < HIGHEST)
    return points[~passing]
