"""What callers give to a method or an index: taken, or refused before anything changes."""

import numpy as np
import pytest
import torch

from deepring.errors import ConfigError, DataError
from deepring.methods.deepring import DeepRing
from deepring.methods.disco import Disco, DiscoSettings
from deepring.methods.egonn import EgoNnGlobal, EgoNnSettings
from deepring.methods.fast_histogram import FastHistogram
from deepring.methods.lidar_iris import LidarIris
from deepring.methods.locnet import LocNet, LocNetSettings
from deepring.methods.m2dp import M2dp
from deepring.methods.method import index_of
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.methods.registry import register_method
from deepring.methods.rinet import RINet, RINetSettings
from deepring.methods.ring import Ring
from deepring.methods.ring_plus_plus import RingPlusPlus
from deepring.methods.scan_context import ScanContext
from deepring.methods.scan_context_plus_plus import CartContext, PolarContext
from deepring.rasters import (
    BevRaster,
    ContextRaster,
    FeatureBevRaster,
    HeightRangesRaster,
    HeightRaster,
    IrisRaster,
    M2dpRaster,
    PointsRaster,
    PolarContextRaster,
    RingHistogramRaster,
    VoxelRaster,
    raster_settings,
)
from deepring.testing import walls
from helpers.networks import deepring_settings
from helpers.tiny_methods import TINY

BEV = BevRaster(cells=16)


def small(name):
    """A small method of each kind."""
    torch.manual_seed(0)
    match name:
        case "deepring":
            settings = deepring_settings(raster_settings(BEV), angles=16, bins=16, widths=(2,))
            return DeepRing(settings)
        case "deepring l2":
            settings = deepring_settings(
                raster_settings(BEV), angles=16, bins=16, widths=(2,), similarity="l2"
            )
            return DeepRing(settings)
        case "ring":
            return Ring(BEV, 16, 16)
        case "ring published":
            return Ring(BEV, 16, 16, "published")
        case "ring++":
            return RingPlusPlus(FeatureBevRaster(cells=16), 16, 16)
        case "scan context":
            return ScanContext(ContextRaster(12, 6))
        case "fast histogram":
            return FastHistogram()
        case "m2dp":
            return M2dp(M2dpRaster(signs=4))
        case "lidar iris":
            return LidarIris(IrisRaster(24, 16))
        case "polar context":
            return PolarContext(PolarContextRaster(12, 6, sideways=(0.0, 2.0)))
        case "cart context":
            return CartContext()
        case "disco":
            raster = raster_settings(HeightRaster(layers=4, sectors=16, rings=16))
            return Disco(DiscoSettings(raster=raster, widths=(2, 2), size=8))
        case "locnet":
            raster = raster_settings(RingHistogramRaster(rows=16, buckets=16))
            return LocNet(LocNetSettings(raster, channels=(2, 2), dimension=4))
        case "lpdnet":
            return TINY["lpdnet"]()
        case "locus":
            return TINY["locus"]()
        case "rinet":
            raster = raster_settings(HeightRangesRaster(sectors=12, bands=4))
            return RINet(RINetSettings(raster, widths=(2, 4), steps=(3,), hidden=4))
        case "lcdnet":
            return TINY["lcdnet"]()
        case "overlapnet":
            return TINY["overlapnet"]()
        case "pointnetvlad":
            raster = raster_settings(PointsRaster(count=32))
            return PointNetVlad(
                PointNetVladSettings(
                    raster=raster,
                    first=(4, 4),
                    second=(4, 8),
                    transform_widths=(4, 8),
                    transform_hidden=(8,),
                    clusters=2,
                    dimension=8,
                )
            )
    raster = raster_settings(VoxelRaster(max_voxels=50, degrees=6, ring=2, height=2))
    return EgoNnGlobal(EgoNnSettings(raster=raster, widths=(2, 2), global_levels=(2,)))


METHODS = (
    *("deepring", "deepring l2", "ring", "ring published", "ring++", "scan context", "disco"),
    *("pointnetvlad", "egonn", "locnet", "rinet", "locus"),
    "lpdnet",
    "overlapnet",
    "lcdnet",
    *("fast histogram", "m2dp", "lidar iris", "polar context", "cart context"),
)


@pytest.fixture(params=METHODS)
def method(request):
    return small(request.param)


def rasters_of(method, n=3):
    return np.stack([method.raster(walls(k), 0.0) for k in range(n)])


def test_arrays_tensors_and_lists_are_described_alike(method):
    arrays = rasters_of(method)
    expected = method.describe(torch.from_numpy(arrays))
    frozen = arrays.copy()
    frozen.setflags(write=False)
    for images in (arrays, frozen, arrays.tolist(), arrays[::-1][::-1]):
        assert torch.allclose(method.describe(images), expected, atol=1e-3)
    for none in (arrays[:0], torch.from_numpy(arrays)[:0]):
        assert method.describe(none).shape == (0, *expected.shape[1:])
    assert torch.equal(method.compare(expected.numpy(), expected).score,
                       method.compare(expected, expected).score)  # fmt: skip


def test_anything_else_is_refused_in_one_line(method):
    arrays = rasters_of(method)
    shape = method.raster.shape
    wrong = [
        *(None, 3, "abc", [], [[1, 2], [3]], object(), np.zeros((0,)), [None]),
        *(arrays[0], arrays[None], arrays[..., :-1], np.zeros((2, 3))),
        *(arrays.astype(np.complex64), torch.from_numpy(arrays).to(torch.complex64)),
        *(np.full((1, *shape), value) for value in (np.nan, np.inf, 1e300)),
    ]
    if method.raster.dtype.kind == "i":
        wrong.append(arrays.astype(np.float32))
    for images in wrong:
        with pytest.raises(DataError, match=r"^rasters: ") as refusal:
            method.describe(images)
        assert "\n" not in str(refusal.value)
    with pytest.raises(DataError, match=r"give \[raster\] for a batch of one"):
        method.describe(arrays[0])


def test_only_descriptors_of_one_shape_are_compared(method):
    descriptors = method.describe(rasters_of(method))
    wrong = [
        *(None, "abc", descriptors[0], descriptors[None], descriptors[..., :-1]),
        *(descriptors.to(torch.complex64), descriptors * torch.nan, descriptors.double() + 1e300),
    ]
    for other in wrong:
        for pair in ((other, descriptors), (descriptors, other)):
            with pytest.raises(DataError, match=r"^(queries|database): "):
                method.compare(*pair)


def state(index, queries):
    hits = index.search(queries, len(index))
    return len(index), hits.place.tolist(), hits.score.tolist()


def test_an_index_is_as_it_was_after_a_refusal(method):
    descriptors = method.describe(rasters_of(method)).float()
    empty, index = index_of(method), index_of(method)
    wrong = [
        *(None, "abc", 3.5, descriptors[..., :-1], descriptors * torch.nan),
        *(descriptors.to(torch.complex64), descriptors.numpy().astype(np.float64) + 1e300),
    ]
    index.add(descriptors.numpy())
    before = state(index, descriptors)
    for other in wrong:
        for use in (index.add, index.search):
            with pytest.raises(DataError):
                use(other)
    for k in (0, -1, 1.5, "a", None, True):
        with pytest.raises(ConfigError, match=r"^k: .* expected a whole number of at least 1"):
            index.search(descriptors, k)
    assert state(index, descriptors) == before
    index.add(descriptors[:0])
    assert state(index, descriptors) == before
    assert index.search(descriptors[:0], 2).place.shape[0] == 0
    # An empty index answers nothing, and learns nothing from what is asked.
    assert empty.search(descriptors[..., :-1], 5).place.shape == (3, 0)
    empty.add(descriptors)
    assert state(empty, descriptors) == before
    assert empty.search(descriptors, 10**12).place.shape == (3, 3)


def test_ranges_of_a_search_among_earlier_places():
    method = small("deepring")
    descriptors = method.describe(rasters_of(method))
    index = index_of(method)
    index.add(descriptors)
    assert index.search(descriptors, 5, before=0).place.shape == (3, 0)
    assert index.search(descriptors, 5, before=99).place.shape == (3, 3)
    for before in (-1, 1.5, "a"):
        with pytest.raises(ConfigError, match=r"^before: "):
            index.search(descriptors, before=before)


def test_what_is_no_method_s_class_is_not_registered():
    for cls in (3, None, "deepring.methods.ring.Ring", Ring()):
        with pytest.raises(ConfigError, match=r"^cls: a .*, expected the class of a method"):
            register_method("mine", cls)
    for name in (3, None, "a b", ""):
        with pytest.raises(ConfigError, match=r"^name: "):
            register_method(name, Ring)
