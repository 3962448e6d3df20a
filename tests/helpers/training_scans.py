"""Training scans at known places."""

import numpy as np

from deepring.data.packed_rasters import Rasters, pack
from deepring.rasters import PolarRaster
from deepring.training.training_scans import TrainingScans

RASTER = PolarRaster(sectors=24, rings=4)


def some_scans(places=12, scans=4, raster=RASTER, headings=None):
    """``places`` 100 m apart along a line, each with ``scans`` scans 2 m apart."""
    n = places * scans
    rng = np.random.default_rng(0)
    place, scan = np.divmod(np.arange(n), scans)
    images = np.stack([pack(rng.random(raster.shape) < 0.2, raster) for _ in range(n)])
    return TrainingScans(
        np.column_stack([100.0 * place + 2.0 * scan, np.zeros(n)]),
        np.zeros(n, dtype=np.int64),
        np.zeros(n) if headings is None else headings,
        Rasters(images, raster),
        np.zeros(n, dtype=np.int64),
    )
