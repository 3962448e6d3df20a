"""Images of a batch of scans in torch against those that the compiled loops draw one by one."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.rasters.kinds import (
    BevRaster,
    ContextRaster,
    HeightRaster,
    PolarRaster,
    RangeRaster,
)
from deepring.rasters.preprocessing import Preprocessing
from deepring.rasters.scan_batch import scans_to_images


def made_up(lengths, ground_z):
    rng = np.random.default_rng(sum(lengths))
    scans = [rng.uniform(-90, 90, (n, 4)).astype(np.float32) for n in lengths]
    for scan in scans:
        scan[:, 2] = rng.normal(ground_z, 4, len(scan))
    return scans


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.integers(0, 3000), min_size=1, max_size=4),
    st.sampled_from([None, 0.5]),
    st.sampled_from([70.0, 40.0]),
    st.floats(-3, 3),
)
def test_birds_eye_images_are_the_same_cell_by_cell(lengths, clearance, extent, ground_z):
    scans = made_up(lengths, ground_z)
    raster = BevRaster(extent=extent, preprocessing=Preprocessing(clearance=clearance))
    found = scans_to_images([torch.from_numpy(scan) for scan in scans], ground_z, raster)
    for scan, image in zip(scans, found, strict=True):
        assert np.array_equal(image, raster(scan, ground_z))


@pytest.mark.parametrize(
    "raster",
    [PolarRaster(), PolarRaster(60, 20, 50.0), ContextRaster(), RangeRaster()],
    ids=["polar", "coarse polar", "context", "range"],
)
def test_polar_images_are_the_same_but_for_points_on_borders(raster):
    scans = made_up([20_000, 0, 7_000], -1.7)
    found = scans_to_images([torch.from_numpy(scan) for scan in scans], -1.7, raster)
    assert found.shape == (3, *raster.shape)
    assert found.numpy().dtype == raster.dtype
    for scan, image in zip(scans, found, strict=True):
        expected = raster(scan, -1.7)
        apart = np.abs(image.numpy().astype(float) - expected.astype(float)) > 1e-2
        assert apart.mean() < 1e-3
    assert found[1].float().max() == 0


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(DeepringError, match="scans: none"):
        scans_to_images([], 0.0, BevRaster())
    with pytest.raises(DeepringError, match="HeightRaster is not drawn in batches"):
        scans_to_images([torch.zeros(1, 3)], 0.0, HeightRaster())
