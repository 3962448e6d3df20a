"""Turning what was drawn equals drawing what was turned."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.rasters import BevRaster, make_raster

BAND = {"height": (-5.0, 20.0), "clearance": None, "extent": 90.0}


def raster(kind, **values):
    return make_raster({"kind": kind, "preprocessing": BAND, **values})


def scan(sectors):
    """Points in the middle of sectors, so that no rounding moves one across a border."""
    rng = np.random.default_rng(0)
    step = 2 * math.pi / sectors
    azimuth = (rng.integers(sectors, size=400) + 0.5) * step
    r, z = rng.uniform(3, 60, 400), rng.uniform(0, 10, 400)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1).astype(np.float32)


@pytest.mark.parametrize(
    "kind",
    ["polar", "context", "iris", "heights", "range", "height_ranges", "voxels", "points"],
)
@pytest.mark.parametrize("turn", [1, 7, 59, -3])
def test_turning_the_raster_is_turning_the_scan(kind, turn):
    values = {name: {"sectors": 60} for name in ("polar", "range", "heights", "height_ranges")}
    if kind == "voxels":
        values["voxels"] = {"degrees": 6.0, "max_voxels": 500}
    if kind == "points":
        values["points"] = {"count": 400}
    made = raster(kind, **values.get(kind, {}))
    steps = made.sectors
    points = scan(60)
    turned = turn_points(points, turn * 2 * math.pi / 60)
    before, after = (torch.from_numpy(made(p, 0.0))[None] for p in (points, turned))
    found = made.turned(before, torch.tensor([turn * steps // 60]))[0]
    if kind in ("points", "voxels"):  # sets: their order is open
        found, after = (np.array(sorted(map(tuple, x.tolist()))) for x in (found, after[0]))
        tolerance = 2e-3 if kind == "points" else 0
        if kind == "points":  # half precision may swap the order of near equals
            found, after = (np.sort(x, axis=0) for x in (found, after))
        assert np.abs(found - after).max() <= tolerance
    else:
        assert torch.equal(found, after[0])


def test_each_image_is_turned_by_its_own_number():
    made = raster("polar", sectors=12, rings=3)
    images = torch.rand(4, 12, 3)
    shifts = torch.tensor([0, 1, 5, -2])
    turned = made.turned(images, shifts)
    for image, shift, found in zip(images, shifts.tolist(), turned, strict=True):
        assert torch.equal(found, image.roll(shift, dims=0))


def test_padding_of_voxels_stays_padding():
    made = raster("voxels", degrees=6.0, max_voxels=1000)
    image = torch.from_numpy(made(scan(60), 0.0))[None]
    turned = made.turned(image, torch.tensor([5]))
    padding = image[..., 0] == torch.iinfo(torch.int16).min
    assert padding.any()
    assert torch.equal(turned[padding], image[padding])
    assert turned.dtype == image.dtype


def test_a_bev_cannot_be_turned():
    with pytest.raises(DeepringError, match="BevRaster cannot be turned"):
        _ = BevRaster().sectors
    with pytest.raises(DeepringError, match="BevRaster cannot be turned, its axes are x, y"):
        BevRaster().turned(torch.zeros(1, 120, 120), torch.tensor([1]))
