"""What docs/extending.md tells a contributor to write, written and run."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.data.cache import RasterCache
from deepring.data.scan_set import ScanSet
from deepring.data.scans.npy import read_npy
from deepring.data.session import Session
from deepring.nn.representation import make_representation
from deepring.rasters import RASTERS, Preprocessing, make_raster, raster_settings
from helpers.pages import blocks_of
from helpers.scenes import scattered

PAGE = "extending.md"


def run_example(heading):
    """The names that the Python block below a heading of the page defines."""
    names = {"__name__": f"docs.{heading.replace(' ', '_')}"}
    exec(compile(blocks_of(PAGE, heading, "python")[0].text, PAGE, "exec"), names)
    return names


@pytest.fixture
def density():
    raster = run_example("A raster")["DensityRaster"]
    yield raster
    del RASTERS["density"]


@pytest.fixture
def drive(tmp_path):
    """Four scans on disk, a metre apart."""
    files = []
    for k in range(4):
        files.append(tmp_path / f"{k}.npy")
        np.save(files[-1], scattered(0) - np.float32([k, 0, 0]))
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = range(4)
    return Session("drive", tuple(files), poses, poses[:, :2, 3], None, read_npy)


def test_the_method_of_the_docs_finds_each_scan_again(drive, tmp_path):
    method = run_example("A method that learns nothing")["Mine"]()
    scans = ScanSet(drive, np.arange(4))
    _, rasters, broken = RasterCache(tmp_path).load(scans, method.raster)
    assert not broken
    descriptors = method.describe(rasters[:])
    comparison = method.compare(descriptors, descriptors)
    assert comparison.turn is None
    assert comparison.score.argmax(dim=1).tolist() == [0, 1, 2, 3]


def test_the_method_of_the_docs_passes_the_check_of_the_docs():
    blocks = [block.text for block in blocks_of(PAGE, "A method that learns nothing", "python")]
    assert "check_method(Mine())" in blocks[1]
    exec(compile("\n".join(blocks), PAGE, "exec"), {"__name__": "docs.checked_method"})


def test_the_raster_of_the_docs_goes_through_settings_and_cache(
    density, drive, tmp_path, monkeypatch
):
    raster = make_raster({"kind": "density", "rings": 40})
    assert raster == density(rings=40)
    assert make_raster(raster_settings(raster)) == raster
    scans, cache = ScanSet(drive, np.arange(4)), RasterCache(tmp_path)
    images = cache.load(scans, raster)[1][:]
    assert images.shape == (4, 60, 40)
    assert np.array_equal(images[2].numpy(), raster(np.load(drive.files[2]), 0.0))
    monkeypatch.delattr(density, "rasterize")  # from now on, the cache alone has them
    assert torch.equal(cache.load(scans, raster)[1][:], images)


def test_the_raster_of_the_docs_can_be_turned_and_seen_by_a_network(density):
    raster = density(preprocessing=Preprocessing(clearance=None))
    rng = np.random.default_rng(0)
    azimuth = (rng.integers(60, size=500) + 0.5) * 2 * math.pi / 60  # in the middle of sectors
    distance = (rng.integers(20, size=500) + 0.5) * 70 / 20
    x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
    points = np.column_stack([x, y, np.ones(500)]).astype(np.float32)
    image = torch.from_numpy(raster(points, 0.0))[None]
    turned = raster(turn_points(points, 7 * 2 * math.pi / 60), 0.0)
    assert torch.equal(raster.turned(image, torch.tensor([7]))[0], torch.from_numpy(turned))
    assert not np.array_equal(turned, image[0])
    assert make_representation(raster, angles=None, bins=None)(image).shape == (1, 1, 60, 20)
