"""Two drives along one road, as a retrieval task of few scans that a method gets partly right."""

import numpy as np

from deepring.core.rigid import turn_points
from deepring.data.dataset import RetrievalSet
from deepring.data.packed_rasters import Rasters, pack
from deepring.data.scan_set import ScanSet
from deepring.data.scans.columns import PointColumn
from deepring.data.session import Session
from deepring.evaluation.task import RetrievalTask
from deepring.testing import with_columns
from helpers.scenes import scattered

PLACES, QUERIES = 12, 70  # more queries than are compared at a time


def road_task(raster, *, turned=False, away=0.0):
    """Places 20 m apart; queries ``away`` metres off the road, some of them of another scene."""
    rng = np.random.default_rng(5)
    scenes = [scattered(k) for k in range(PLACES)]
    database, shown = _side("first", scenes, 20.0 * np.arange(PLACES), 0.0, raster)
    near = rng.uniform(0, 20 * PLACES, QUERIES)
    seen = np.where(rng.random(QUERIES) < 0.7, np.rint(near / 20), rng.integers(0, 99, QUERIES))
    clouds = [scenes[int(k) % PLACES] + _shake(rng) for k in seen]
    turns = rng.uniform(0, 2 * np.pi, QUERIES) if turned else None
    query, asked = _side("second", clouds, near, away, raster, turns)
    return RetrievalTask(RetrievalSet("road", "test", database, query), shown, asked)


def _shake(rng):
    return rng.normal(0, 3, 3).astype(np.float32) * [1, 1, 0.1]


def _side(name, clouds, east, north, raster, turns=None):
    n = len(clouds)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = east + 345090.0
    poses[:, 1, 3] = north + 4037591.0
    points = [turn_points(np.asarray(cloud, dtype=np.float32), 0.0) for cloud in clouds]
    columns = {"label": PointColumn(lambda k: with_columns(points[k], ["label"])[:, 3])}
    files, read = tuple(range(n)), points.__getitem__
    session = Session(name, files, poses, poses[:, :2, 3], None, read, columns=columns)
    scans = ScanSet(session, np.arange(n), 0.25, turns)
    images = [pack(scans.rasterize(k, raster), raster) for k in range(n)]
    return scans, Rasters(np.stack(images), raster)
