"""Peak memory and time of `deepring map build` of a large point cloud.

    python benchmarks/cloud_memory.py [--points 100] [--ordered]

Writes a city of blocks of houses in a PCD file, a million points at a time, and builds a map of it
without a path in a process of its own. Points come in a random order, as no file does in which
tiles could be cut by reading it once; ``--ordered`` writes them as a drive would.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from cloud_on_disk import write_pcd

#: Side of a block with its street, and of its houses, metres; of the height of houses.
BLOCK, HOUSE = 60.0, 36.0
LOT = 1_000_000


def city(rng: np.random.Generator, low: float, high: float, side: float, count: int) -> np.ndarray:
    """Points (count, 3) of streets and walls with x from ``low`` to ``high``."""
    points = np.empty((count, 3))
    points[:, 0], points[:, 1] = rng.uniform(low, high, count), rng.uniform(0, side, count)
    points[:, 2] = rng.normal(0, 0.02, count)
    # Four of ten are on walls: moved to the nearest wall of their block, at any height.
    walls = rng.random(count) < 0.4
    block = np.floor(points[walls, :2] / BLOCK)
    start = (BLOCK - HOUSE) / 2
    axis = rng.integers(0, 2, walls.sum())
    rows = np.arange(walls.sum())
    across = rng.integers(0, 2, walls.sum()) * HOUSE + start
    along = rng.uniform(start, start + HOUSE, walls.sum())
    local = np.empty((walls.sum(), 2))
    local[rows, axis], local[rows, 1 - axis] = across, along
    points[walls, :2] = block * BLOCK + local
    tall = 4 + 10 * np.abs(np.sin(12.9898 * block[:, 0] + 78.233 * block[:, 1]))
    points[walls, 2] = rng.uniform(0, 1, walls.sum()) * tall
    inside = ~walls & (np.abs(points[:, :2] % BLOCK - BLOCK / 2) < HOUSE / 2).all(axis=1)
    return points[~inside]


def write_city(file: Path, millions: int, ordered: bool) -> float:
    """The file, and the side of the city in metres."""
    rng = np.random.default_rng(0)
    side = BLOCK * max(2, round((millions * 1e6 / 100) ** 0.5 / BLOCK))  # 100 points a square metre

    def lots() -> Iterator[np.ndarray]:
        for lot in range(round(millions * 1.25)):
            share = lot / (millions * 1.25)
            low, high = (side * share, side * share + 5) if ordered else (0.0, side)
            yield city(rng, low, min(high, side), side, LOT)

    count = write_pcd(file, lots(), 4)
    print(f"{count / 1e6:.0f} million points, {side:.0f} x {side:.0f} m")
    return side


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=100, help="millions")
    parser.add_argument("--spacing", type=float, default=20.0, help="metres between places")
    parser.add_argument("--ordered", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "city.pcd"
        write_city(file, args.points, args.ordered)
        words = ["map", "build", str(file), "--spacing", str(args.spacing)]
        started = time.perf_counter()
        child = subprocess.Popen(
            [sys.executable, "-m", "deepring", *words, "-o", str(file.with_suffix(".map"))]
        )
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - started
    print(
        f"status {os.waitstatus_to_exitcode(status)}, {seconds:.0f} s, of them "
        f"{usage.ru_utime + usage.ru_stime:.0f} s of processor time, peak memory "
        f"{usage.ru_maxrss / 1e6:.2f} GB"
    )


if __name__ == "__main__":
    main()
