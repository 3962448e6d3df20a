"""Scan -> BEV -> sinogram: milliseconds a scan on one core, beside the usual routes.

    python benchmarks/sinogram.py [--points 70000] [--runs 100]

Compares our compiled path, our pure-torch Radon transform, and scikit-image's `radon` after a
NumPy histogram, on the same simulated scan. Prints medians and inter-quartile ranges.
"""

import argparse
import platform
import time

import numba
import numpy as np
import skimage
import torch
from skimage.transform import radon as skimage_radon

from deepring.core.bev import disc_mask
from deepring.core.ground import Preprocessing
from deepring.core.radon import _half_turn, radon
from deepring.core.rasters import BevRaster
from deepring.core.scan_bev import scan_to_bev


def scan(points: int) -> np.ndarray:
    """A street scene: ground, facades and poles; (points, 3) float32."""
    rng = np.random.default_rng(0)
    ground = np.column_stack(
        [rng.normal(0, 20, (points // 2, 2)), rng.normal(0, 0.03, points // 2)]
    )
    rest = points - len(ground)
    walls = np.concatenate(
        [rng.uniform(-60, 60, (rest, 1)), rng.choice([-12.0, 14.0], (rest, 1))], 1
    )
    across = rng.random(rest) < 0.4
    walls[across] = walls[across][:, ::-1] * [1.0, 0.8]
    walls += rng.normal(0, 0.05, walls.shape)
    facades = np.column_stack([walls, rng.uniform(0, 12, rest)])
    return np.concatenate([ground, facades]).astype(np.float32)


def timed(function, runs: int) -> tuple[float, float, float]:
    for _ in range(3):
        function()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        times.append((time.perf_counter() - start) * 1e3)
    low, median, high = np.percentile(times, [25, 50, 75])
    return float(low), float(median), float(high)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=70_000)
    parser.add_argument("--runs", type=int, default=100)
    args = parser.parse_args()
    torch.set_num_threads(1)

    points = scan(args.points)
    raster, band = BevRaster(), Preprocessing(height=(1.0, 20.0), clearance=None)
    bev = raster(points, 0.0)
    image = torch.from_numpy(bev)[None]
    angles = np.arange(120) * 3.0

    def numpy_bev() -> np.ndarray:
        kept = points[(points[:, 2] > 1.0) & (points[:, 2] < 20.0)]
        counts, _, _ = np.histogram2d(kept[:, 0], kept[:, 1], bins=120, range=[[-70, 70]] * 2)
        return (counts > 0) & disc_mask(120)

    def published() -> np.ndarray:
        return skimage_radon(numpy_bev().astype(np.float32), theta=angles)

    def ours() -> torch.Tensor:
        return radon(torch.from_numpy(raster(points, 0.0))[None])

    def ours_band() -> torch.Tensor:
        return radon(torch.from_numpy(scan_to_bev(points, 0.0, band))[None])

    def pure_torch() -> torch.Tensor:
        half = _half_turn(torch.from_numpy(raster(points, 0.0))[None].float(), 60, 120)
        return torch.cat([half, half.flip(-1)], dim=-2)

    rows = {
        "points -> BEV (ground removed)": lambda: raster(points, 0.0),
        "points -> BEV (height band)": lambda: scan_to_bev(points, 0.0, band),
        "BEV -> sinogram, compiled": lambda: radon(image),
        "BEV -> sinogram, pure torch": lambda: _half_turn(image.float(), 60, 120),
        "BEV -> sinogram, scikit-image": lambda: skimage_radon(
            bev.astype(np.float32), theta=angles
        ),
        "scan -> sinogram, ours (ground removed)": ours,
        "scan -> sinogram, ours (height band)": ours_band,
        "scan -> sinogram, torch Radon (ground removed)": pure_torch,
        "scan -> sinogram, NumPy + scikit-image (height band)": published,
    }
    print(
        f"{platform.processor() or platform.machine()}, one thread, {args.points} points, "
        f"{int(bev.sum())} occupied cells, numba {numba.__version__}, torch {torch.__version__}, "
        f"scikit-image {skimage.__version__}\n"
    )
    print("| stage | median ms | IQR ms |\n| --- | ---: | ---: |")
    for name, function in rows.items():
        low, median, high = timed(function, args.runs)
        print(f"| {name} | {median:.3f} | {low:.3f} - {high:.3f} |")


if __name__ == "__main__":
    main()
