"""Small clouds of streets, and files of them."""

import numpy as np

from deepring.data.clouds.tiles import Tile, TiledCloud


def ground(low, high, step=0.25, z=0.0, seed=0):
    """Level ground (n, 3) over the square from ``low`` to ``high``, a little rough."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(low, high, step), np.arange(low, high, step), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)
    return points + rng.uniform(-0.05, 0.05, points.shape)


def wall(start, end, low=0.0, high=6.0, step=0.2):
    """A wall (n, 3) from ``start`` to ``end`` (2,)."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    along = np.arange(0, np.linalg.norm(end - start), step)[:, None]
    foot = start + along * (end - start) / np.linalg.norm(end - start)
    heights = np.arange(low, high, step)
    return np.concatenate([np.column_stack([foot, np.full(len(foot), z)]) for z in heights])


def street(seed=0, half=40.0):
    """Ground with houses, each of four walls, in random places (n, 3) float64."""
    rng = np.random.default_rng(seed)
    parts = [ground(-half, half, 0.4, seed=seed)]
    for _ in range(12):
        x, y = rng.uniform(-half + 8, half - 8, 2)
        if max(abs(x), abs(y)) < 10:
            continue
        a, b, h = rng.uniform(3, 7), rng.uniform(3, 7), rng.uniform(3, 9)
        corners = np.array([[x - a, y - b], [x + a, y - b], [x + a, y + b], [x - a, y + b]])
        inside = (np.abs(parts[0][:, :2] - [x, y]) < [a, b]).all(axis=1)
        parts[0] = parts[0][~inside]
        parts += [wall(corners[k], corners[(k + 1) % 4], 0, h) for k in range(4)]
    return np.concatenate(parts)


def in_tiles(points, side=1000.0, passing=True):
    """A cloud of points (n, 3) in tiles of ``side`` metres, in memory."""
    keys = np.floor(points[:, :2] / side).astype(int)
    tiles = []
    for i, j in np.unique(keys, axis=0):
        corner = np.array([i * side, j * side, 0.0])
        local = (points[(keys == [i, j]).all(axis=1)] - corner).astype(np.float32)
        tiles.append(Tile(f"{i} {j}", corner, np.array([side, side]), lambda p=local: p))
    return TiledCloud("streets", tiles, len(points), passing=passing)


def pcd_bytes(points, kind="f4", data="binary"):
    """A PCD file of points (n, 3)."""
    size = int(kind[1])
    head = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE {size} {size} {size}\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA {data}\n"
    ).encode()
    if data == "ascii":
        return head + "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()).encode()
    return head + points.astype(f"<{kind}").tobytes()
