"""A scan of which nothing is to be seen is refused with its cause, in every raster and path."""

import numpy as np
import pytest

from deepring.data.cache import RasterCache, load_rasters
from deepring.data.scan_set import ScanSet
from deepring.data.scans.npy import read_npy
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DataError
from deepring.localization.map import Map
from deepring.localization.observation import LEAST_CELLS
from deepring.rasters import RASTERS, BevRaster, Preprocessing
from deepring.rasters.blank import blank_reason
from deepring.testing import with_columns
from helpers.networks import small_network
from helpers.scenes import scattered

SCENE = scattered(0)
FLOOR = np.column_stack(
    [np.random.default_rng(0).uniform(-60, 60, (3000, 2)), np.full(3000, -1.7)]
).astype(np.float32)
SCENE_AND_FLOOR = np.concatenate([SCENE - np.float32([0, 0, 1.7]), FLOOR])


PLACE_MAP = Map(small_network(), ground_z=-1.7)


@pytest.mark.parametrize(
    ("points", "cause"),
    [
        (SCENE_AND_FLOOR + np.float32([345_000, 4_037_000, 30]), "look like world coordinates"),
        (SCENE_AND_FLOOR + np.float32([-300, 250, 0]), "look like world coordinates"),
        (SCENE_AND_FLOOR * np.float32(1000), "look like millimetres"),
        (SCENE_AND_FLOOR[np.abs(SCENE_AND_FLOOR[:, 0]) > 2] * np.float32(100), "or centimetres"),
        (SCENE_AND_FLOOR / np.float32(1000), "all lie within 0.06 m, expected metres"),
        (SCENE_AND_FLOOR / np.float32(60), "scaled to [-1, 1]"),
        (FLOOR, "the ground at -1.7 m; nothing or little is more than 0.5 m above the ground"),
        (FLOOR + np.float32([0, 0, 40]), "the lowest of them are at 38.3 m: set `ground_z`"),
        (SCENE_AND_FLOOR - np.float32([0, 0, 60]), "ground_z = -1.7 m; the lowest of them are at"),
        (np.float32([[10, 5, 1]]), "1 points, 1 of them within 70 m"),
        (np.float32([[100, 5, 1], [0, -99, 1]]), "2 points, 0 of them within 70 m"),
        (np.float32([[3, 4, 1e30], [3, 4, -1e30]]), "2 points"),
    ],
)
def test_what_is_wrong_with_it_is_said(points, cause):
    with pytest.raises(
        BrokenScanError, match=r"^scan: (nothing|only) .* out of the ground: "
    ) as told:
        PLACE_MAP.observe([points])
    assert cause in str(told.value)
    assert "\n" not in str(told.value)


def test_what_shows_enough_is_described():
    assert PLACE_MAP.observe([SCENE_AND_FLOOR]).images.sum() > LEAST_CELLS
    # Ten posts on the ground are enough, nine are not.
    posts = np.array([[5.0 * k, 5.0 * k, 1.0] for k in range(-5, 5)], np.float32)
    posts = np.concatenate([posts, posts - np.float32([0, 0, 2.7])])
    assert PLACE_MAP.observe([posts]).images.sum() == LEAST_CELLS
    with pytest.raises(BrokenScanError, match="only 9 cells stand out of the ground"):
        PLACE_MAP.observe([np.delete(posts, 0, axis=0)])


@pytest.mark.parametrize("kind", RASTERS)
def test_every_raster_knows_when_it_is_blank(kind):
    raster = RASTERS[kind]()
    far = with_columns(SCENE + np.float32([1000, 0, 0]), raster.columns)
    assert raster.is_blank(raster(far, 0.0))
    assert not raster.is_blank(raster(with_columns(SCENE_AND_FLOOR, raster.columns), -1.7))


def session(folder, clouds):
    files = []
    for k, points in enumerate(clouds):
        files.append(folder / f"{k}.npy")
        np.save(files[-1], points)
    poses = np.tile(np.eye(4), (len(files), 1, 1))
    return Session("s", tuple(files), poses, poses[:, :2, 3].copy(), None, read_npy)


@pytest.mark.parametrize("kind", ["bev", "polar", "voxels"])
def test_blank_scans_are_left_out_of_training_and_evaluation(kind, tmp_path, caplog):
    raster = RASTERS[kind]()
    blank = SCENE * np.float32(1000)
    scans = session(tmp_path, [blank, *[SCENE_AND_FLOOR] * 5])
    for _ in range(2):  # it is not kept in the cache either
        caplog.clear()
        readable, _ = load_rasters(
            RasterCache(tmp_path / "c"), ScanSet(scans, np.arange(6), -1.7), raster, "queries"
        )
        assert readable.indices.tolist() == [1, 2, 3, 4, 5]
        (record,) = caplog.records
        assert "queries: left out 1 of 6 scans" in record.getMessage()
        assert "0.npy: nothing stands out" in record.getMessage()


def test_blank_rasters_of_earlier_versions_are_not_taken_from_the_cache(tmp_path, monkeypatch):
    raster, cache = BevRaster(cells=24), RasterCache(tmp_path / "c")
    clouds = [SCENE * np.float32(1000), SCENE_AND_FLOOR]
    scans = ScanSet(session(tmp_path, clouds), np.arange(2), -1.7)
    with monkeypatch.context() as earlier:
        earlier.setattr(BevRaster, "is_blank", lambda *_: False)
        assert len(cache.load(scans, raster)[0]) == 2
    readable, rasters, (reason,) = cache.load(scans, raster)
    assert readable.indices.tolist() == [1]
    assert rasters[:].any(dim=(1, 2)).all()
    assert "look like millimetres" in reason


def test_too_many_blank_scans_are_an_error(tmp_path):
    scans = session(tmp_path, [SCENE * np.float32(1000)] * 2 + [SCENE_AND_FLOOR] * 5)
    with pytest.raises(DataError, match=r"queries: 2 or more of 7 scans .* at most 20%.*millimet"):
        load_rasters(
            RasterCache(tmp_path / "c"), ScanSet(scans, np.arange(7), -1.7), BevRaster(), "queries"
        )


def test_the_reason_may_be_asked_for_any_band():
    preprocessing = Preprocessing(height=(1.0, 4.0), clearance=None, extent=30.0)
    reason = blank_reason(FLOOR, -1.7, preprocessing)
    assert "have z from -0.7 to 2.3 m" in reason
    assert "within 30 m" in reason
