"""EgoNN as a method: from points to descriptors, compared by their distance."""

import numpy as np
import pytest
import torch

from deepring.errors import DeepringError
from deepring.methods.egonn import EgoNnGlobal, EgoNnSettings
from deepring.methods.method import Method
from deepring.rasters import PointsRaster, Preprocessing, VoxelRaster, raster_settings
from deepring.rasters.voxels import PADDING
from helpers.scenes import scattered

RASTER = VoxelRaster(
    max_voxels=6000, degrees=4.0, ring=1.0, height=0.5, preprocessing=Preprocessing(clearance=None)
)


def method(**changes):
    torch.manual_seed(0)
    small = {"widths": (4, 8, 8), "global_levels": (2, 3)}
    return EgoNnGlobal(EgoNnSettings(raster=raster_settings(RASTER), **{**small, **changes})).eval()


def scans(count):
    drawn = [RASTER(scattered(seed).astype(np.float32), 0.0) for seed in range(count)]
    return torch.from_numpy(np.stack(drawn))


def test_it_is_a_method_and_its_settings_make_it_again():
    net = method()
    assert isinstance(net, Method)
    again = EgoNnGlobal(EgoNnSettings.from_dict(net.settings.to_dict()))
    again.load_state_dict(net.state_dict())
    images = scans(3)
    assert torch.equal(again.describe(images), net.describe(images))
    assert net.describe(images).shape == (3, 256)


def test_at_unit_norm_the_directions_are_the_same():
    images = scans(3)
    plain, unit = method().describe(images), method(normalised=True).describe(images)
    assert not torch.allclose(plain.norm(dim=1), torch.ones(3), atol=0.01)
    assert torch.allclose(unit, plain / plain.norm(dim=1, keepdim=True), atol=1e-6)


def test_padding_and_the_rest_of_the_batch_change_nothing():
    net, images = method(), scans(3)
    longer = torch.full((3, 7000, 3), PADDING, dtype=images.dtype)
    assert (images == PADDING).any()
    longer[:, :6000] = images
    together = net.describe(images)
    with torch.no_grad():
        assert torch.allclose(net.eval()(longer), together, atol=1e-6)
    assert torch.allclose(net.describe(images[1:2]), together[1:2], atol=1e-5)


def test_a_scan_finds_itself_and_knows_no_yaw():
    net, images = method(), scans(4)
    descriptors = net.describe(images)
    found = net.compare(descriptors, descriptors)
    assert found.turn is None
    assert torch.equal(found.score.argmax(dim=1), torch.arange(4))
    assert torch.allclose(found.score.diagonal(), torch.zeros(4), atol=1e-6)


def test_another_raster_is_refused_by_name():
    with pytest.raises(DeepringError, match=r"EgoNN: raster: a PointsRaster, expected"):
        EgoNnGlobal(EgoNnSettings(raster=raster_settings(PointsRaster())))
