"""Scan -> image -> sinogram, and the images of other methods, beside the usual routes."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from scenes import scan
from skimage.transform import radon as skimage_radon
from timing import Row, timed

from deepring.core.radon import _half_turn, radon
from deepring.data.cache import RasterCache
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.rasters import BevRaster, ContextRaster, PolarRaster, Preprocessing, RangeRaster
from deepring.rasters.bev import disc_mask, scan_to_bev

BAND = Preprocessing(height=(1.0, 20.0), clearance=None)


def numpy_bev(points: np.ndarray) -> np.ndarray:
    kept = points[(points[:, 2] > 1.0) & (points[:, 2] < 20.0)]
    counts, _, _ = np.histogram2d(kept[:, 0], kept[:, 1], bins=120, range=[[-70, 70]] * 2)
    return (counts > 0) & disc_mask(120)


def scan_stages(runs: int, sizes: tuple[int, ...] = (20_000, 70_000, 200_000)) -> Iterator[Row]:
    """From points to sinograms, over the number of points."""
    angles = np.arange(120) * 3.0
    raster = BevRaster()
    for n in sizes:
        points = scan(n)
        bev = raster(points, 0.0)
        image = torch.from_numpy(bev)[None]
        assert np.array_equal(scan_to_bev(points, 0.0, BAND), numpy_bev(points))
        stages = {
            "reading the points (sum)": lambda points=points: points.sum(),
            "scan to BEV, height band": lambda points=points: scan_to_bev(points, 0.0, BAND),
            "scan to BEV, ground removed": lambda points=points: raster(points, 0.0),
            "BEV to sinogram": lambda image=image: radon(image),
            "BEV to sinogram, pure torch": lambda image=image: _half_turn(image.float(), 60, 120),
            "scan to sinogram, height band": lambda points=points: radon(
                torch.from_numpy(scan_to_bev(points, 0.0, BAND))[None]
            ),
            "scan to sinogram, ground removed": lambda points=points: radon(
                torch.from_numpy(raster(points, 0.0))[None]
            ),
            "scan to polar gram": lambda points=points: PolarRaster()(points, 0.0),
            "scan to Scan Context 20x60": lambda points=points: ContextRaster()(points, 0.0),
            "scan to range image": lambda points=points: RangeRaster()(points, 0.0),
        }
        for what, function in stages.items():
            yield Row("scan", what, n, *timed(function, runs), "scan")
        usual = {
            "peer: BEV to sinogram, scikit-image": lambda bev=bev: skimage_radon(
                bev.astype(np.float32), theta=angles
            ),
            "peer: scan to sinogram, NumPy and scikit-image": lambda points=points: skimage_radon(
                numpy_bev(points).astype(np.float32), theta=angles
            ),
        }
        for what, function in usual.items():
            yield Row("scan", what, n, *timed(function, max(3, runs // 10)), "scan")


def cache_stages(runs: int, scans: int = 2000) -> Iterator[Row]:
    """Loading BEVs that were drawn before."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        few = scan(50)
        paths = [folder / f"{k:05d}.npy" for k in range(scans)]
        for path in paths:
            np.save(path, few)
        poses = np.tile(np.eye(4), (scans, 1, 1))
        session = Session("drive", tuple(paths), poses, np.zeros((scans, 2)), None, np.load)
        every, cache, raster = ScanSet(session, np.arange(scans)), RasterCache(folder), BevRaster()
        cache.load(every, raster)
        seconds = timed(lambda: cache.load(every, raster)[1][:], max(3, runs // 10), scans)
        yield Row("cache", "cached BEV, found, read and unpacked", scans, *seconds, "scan")


def gpu_stages(runs: int, batch: int = 256) -> Iterator[Row]:
    """The pure-torch Radon transform of a batch that lies on the GPU."""
    one = torch.from_numpy(BevRaster()(scan(70_000), 0.0))
    images = one.expand(batch, -1, -1).contiguous().cuda()

    def transform() -> None:
        radon(images)
        torch.cuda.synchronize()

    yield Row("scan", "BEV to sinogram, CUDA", batch, *timed(transform, runs, batch), "scan")
