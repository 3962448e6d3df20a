"""Peak memory of an evaluation over a session of 28 000 full-size scans.

    python benchmarks/memory.py [--scans 28000]

Writes one dense 64 x 1024 MulRan scan of a few places, links it 28 000 times under two session
names along a long road, and evaluates RING on all of it at the protocol's spacings (20 m and 5 m)
in this process. What is measured is memory; the recall of a road of copies means nothing.
"""

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from deepring.data.cache import RasterCache
from deepring.data.dataset import DatasetConfig, PlaceDataset, Regions
from deepring.evaluation.protocol import evaluate_method
from deepring.evaluation.task import load_task
from deepring.methods.ring import Ring


def write_session(root: Path, name: str, scans: int, across: float) -> None:
    """A straight road, one scan a metre, each a link to one of eight dense scans."""
    rng = np.random.default_rng(0)
    lidar = root / name / "Ouster"
    lidar.mkdir(parents=True)
    originals = []
    for k in range(8):
        points = rng.normal(0, 25, (64 * 1024, 4)).astype("<f4")
        points[:, 2] = rng.uniform(-1.8, 10, len(points))
        originals.append(root / f"{name}_{k}.bin")
        points.tofile(originals[-1])
    stamps = 1_600_000_000_000_000_000 + np.arange(scans, dtype=np.int64) * 100_000_000
    rows = []
    for k, stamp in enumerate(stamps):
        os.link(originals[k % 8], lidar / f"{stamp}.bin")
        rows.append(f"{stamp},1,0,0,{345000 + k + across},0,1,0,{4037000.0},0,0,1,20\n")
    (root / name / "global_pose.csv").write_text("".join(rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=28_000)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for name, across in (("A", 0.0), ("B", 3.0)):
            write_session(root, name, args.scans, across)
        config = DatasetConfig(
            name="road",
            format="mulran",
            root=folder,
            database="A",
            query="B",
            regions=Regions(validation_share=0.0),
            ground_z=-1.8,
        )
        method, cache = Ring(), RasterCache(root / "cache")
        started = time.perf_counter()
        task = load_task(cache, PlaceDataset(config).retrieval("whole"), method.raster)
        outcome = evaluate_method(task.case("RING"), method, task)
        seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    head = outcome.results[0]
    print(
        f"{args.scans} scans of {64 * 1024} points a session: {head.queries} queries in "
        f"{head.database} places, {seconds:.0f} s, peak memory {peak:.2f} GB"
    )


if __name__ == "__main__":
    main()
