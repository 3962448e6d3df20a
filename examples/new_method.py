"""A new method, beside RING.

A method says which image of a scan it sees, makes descriptors of the images, and compares them.
Everything else follows: the check of what it has to satisfy, the cache of images, the search, the
rates.
"""

from pathlib import Path

import numpy as np
import torch

from deepring import BevRaster, Ring, check_method, evaluate_method, open_session
from deepring.data.cache import RasterCache
from deepring.data.dataset import RetrievalSet
from deepring.data.scan_set import ScanSet
from deepring.evaluation.task import load_task
from deepring.methods.method import Comparison
from deepring.simulation.presets import preset, with_knobs
from deepring.simulation.simulate import simulate


class Rings:
    """How many cells are occupied at each distance from the sensor, whatever its heading."""

    def __init__(self, rings: int = 20) -> None:
        self.raster = BevRaster()  # (120, 120) cells, seen from above
        axis = torch.linspace(-1, 1, self.raster.cells)
        ring = (torch.hypot(axis[:, None], axis[None]) * rings).long()
        self.rings = torch.stack([(ring == k).float() for k in range(rings)])

    def describe(self, rasters):
        """Descriptors (b, rings) of images (b, 120, 120)."""
        counts = torch.einsum("bxy,rxy->br", rasters.float(), self.rings)
        return counts / counts.norm(dim=1, keepdim=True).clamp_min(1e-9)

    def compare(self, queries, database):
        """Scores (q, d), higher is more alike; the heading stays unknown."""
        return Comparison(score=queries @ database.T, turn=None)


check_method(Rings())

small = {"block": 45.0, "train_columns": 2, "test_columns": 2, "rows": 2, "azimuths": 128}
street = simulate(with_knobs(preset("custom"), {**small, "scan_spacing": 5.0}), Path("street"))
first, second = (open_session("custom", street / "drive.yaml", name) for name in ("map", "query"))
places, queries = (ScanSet(drive, np.arange(0, len(drive), 2)) for drive in (first, second))
for method in (Rings(), Ring()):
    scans = RetrievalSet("street", "whole", places, queries)
    task = load_task(RasterCache(Path("cache")), scans, method.raster)
    name = type(method).__name__
    result = evaluate_method(task.case(name), method, task, radii=[10.0]).results[0]
    print(f"{name:6} finds {result.recall_1:.2f} of {result.answerable} queries within 10 m")
