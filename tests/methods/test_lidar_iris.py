"""LiDAR-Iris: worked values of image and filters, and bits compared one by one."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError, DataError
from deepring.methods.lidar_iris import LidarIris, best_agreement
from deepring.methods.lidar_iris.iris_code import IrisCode, iris_code, log_gabor, packed, unpacked
from deepring.methods.lidar_iris.iris_index import IrisIndex
from deepring.methods.method import index_of
from deepring.rasters import IrisRaster, Preprocessing
from deepring.rasters.iris import occupied_layers
from deepring.testing import walls

SMALL = IrisRaster(sectors=72, rings=20)


def images(n, seed=0, shape=(36, 7)):
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 256, (n, *shape)) * (rng.random((n, *shape)) < 0.2)
    values[:, :, rng.random(shape[1]) < 0.3] = 0  # rings without any point
    return torch.from_numpy(values.astype(np.uint8))


def codes(n, seed=0, shape=(36, 7)):
    return packed(iris_code(images(n, seed, shape)))


def distance_by_loop(query, entry):
    """The least share of differing bits over all shifts, and the first shift, of bits (θ, n)."""
    best = (1.0, 0)
    for shift in range(len(query.real)):
        real, imaginary, counts = (bits.roll(-shift, dims=0) for bits in query)
        both = counts & entry.counts
        valid = 2 * int(both.sum())
        differ = int(((real ^ entry.real) & both).sum())
        differ += int(((imaginary ^ entry.imaginary) & both).sum())
        if valid and differ / valid < best[0]:
            best = (differ / valid, shift)
    return best


def first(code):
    return IrisCode(*(bits[0] for bits in code))


def test_one_point_sets_one_bit():
    point = np.array([[10.5, 0.2, -1.7]], dtype=np.float32)
    image = occupied_layers(point)  # in the sensor's frame
    assert np.argwhere(image).tolist() == [[181, 10]]
    assert image[181, 10] == 16
    assert np.array_equal(IrisRaster()(point, -1.73), image)  # whatever the ground's height
    above = point - [0, 0, -1.73]
    assert np.array_equal(IrisRaster()(above, 0.0), image)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 40), st.integers(1, 12), st.integers(0, 999))
def test_image_against_a_loop(sectors, rings, seed):
    rng = np.random.default_rng(seed)
    points = (rng.normal(size=(200, 3)) * [30, 30, 4]).astype(np.float32)
    expected = np.zeros((sectors, rings), dtype=int)
    for x, y, z in points.astype(np.float64):
        column = math.floor(math.degrees(math.atan2(y, x) + math.pi) / 360 * sectors + 0.5)
        ring = min(math.floor(math.hypot(x, y) / 50 * rings), rings - 1)
        expected[column % sectors, ring] |= 1 << min(max(math.ceil(z + 3.27), 0), 7)
    assert np.array_equal(occupied_layers(points, 50.0, sectors, rings, -3.27), expected)


def test_the_seam_wraps():
    behind = np.array([[-20.0, 0.01, 0.0], [-20.0, -0.01, 0.0]], dtype=np.float32)
    assert np.argwhere(occupied_layers(behind)).tolist() == [[0, 20]]  # not also 359


def test_the_published_filters():
    filters = log_gabor()
    assert filters.sum(dim=1).tolist() == pytest.approx([15.0316, 9.3947, 5.8717, 3.6699], abs=1e-4)
    assert filters.argmax(dim=1).tolist() == [20, 13, 8, 5]
    assert filters[0, 40].item() == pytest.approx(0.0549, abs=1e-4)  # twice the centre
    assert not filters[:, 0].any()


def test_a_single_cell_in_a_ring():
    image = torch.zeros(1, 360, 80)
    image[0, 100, 0] = 16
    real, imaginary, counts = iris_code(image)
    assert [int(real[0, :, 80 * scale].sum()) for scale in range(4)] == [196, 195, 169, 178]
    assert real[0, 100, ::80].all()
    assert not imaginary[0, 100, ::80].any()  # odd about the cell: exactly 0 there
    assert not counts[0, :, 1].any()
    assert counts[0, 100, ::80].all()


def test_a_ring_that_is_the_same_all_around_does_not_count():
    image = torch.full((1, 360, 3), 255.0)
    assert not iris_code(image).counts.any()


@pytest.mark.parametrize("shift", [1, 5, 180, 359])
def test_codes_of_a_turned_image_are_turned(shift):
    image = images(1, 3, (360, 20))
    whole, rolled = iris_code(image), iris_code(image.roll(shift, dims=1))
    for bits, other in zip(whole, rolled, strict=True):
        assert torch.equal(bits.roll(shift, dims=1), other)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 3), st.integers(1, 9), st.integers(1, 30), st.integers(0, 99))
def test_packing_loses_nothing(n, sectors, bits, seed):
    rng = np.random.default_rng(seed)
    code = IrisCode(*(torch.from_numpy(rng.random((n, sectors, bits)) < 0.5) for _ in range(3)))
    back = unpacked(packed(code))
    assert back.real.shape[-1] % 64 == 0
    for part, found in zip(code, back, strict=True):
        assert torch.equal(found[..., :bits], part)
        assert not found[..., bits:].any()


def test_both_forms_of_the_distance_against_a_loop():
    queries, database = codes(3, 1), codes(5, 2)
    by_fft = best_agreement(queries, database)
    index = IrisIndex()
    index.add(database)
    score, shift = index.scores(queries)
    for q in range(3):
        for d in range(5):
            expected, where = distance_by_loop(
                first(unpacked(queries[q : q + 1])), first(unpacked(database[d : d + 1]))
            )
            for found in (by_fft.score, score):
                assert 1 - found[q, d].item() == pytest.approx(expected, abs=1e-6)
            assert shift[q, d] == by_fft.shift[q, d] == where


def test_a_roll_costs_nothing_and_is_the_turn():
    entry = codes(1, 4, (72, 9))
    score, turn = LidarIris(SMALL).compare(entry.roll(7, dims=1), entry)
    assert score.item() == 1
    assert turn.item() == pytest.approx(7 * 2 * math.pi / 72, abs=1e-5)


def test_a_scan_turned_by_whole_sectors_is_the_same_place():
    method, points = LidarIris(), walls(0)
    angle = 40 * 2 * math.pi / 360
    query, entry, other = (
        method.describe(method.raster(scan, 0.0)[None])
        for scan in (turn_points(points, angle), points, walls(1))
    )
    score, turn = method.compare(query, entry)
    assert score > 0.95  # a few points change cells by rounding
    assert turn.item() == pytest.approx(angle, abs=1e-4)  # not its negative
    assert method.compare(query, other).score < 0.7


@pytest.mark.parametrize("wrong", [0.5, -1.0, 65536.0, 1e30])
def test_numbers_that_are_no_bits_are_refused(wrong):
    code = codes(1)
    bad = code.clone()
    bad[0, 3, 4] = wrong
    with pytest.raises(DataError, match=r"descriptors: .* expected whole ones from 0 to 65535"):
        LidarIris(SMALL).compare(bad, code)
    index = IrisIndex()
    with pytest.raises(DataError, match="describe the scans by LidarIris"):
        index.add(bad)
    assert len(index) == 0


def test_descriptors_are_of_the_type_that_is_exported():
    described = LidarIris(SMALL).describe(SMALL(walls(0), 0.0)[None])
    assert described.dtype == torch.float32
    assert described.shape[1:] == LidarIris(SMALL).descriptor_shape
    assert described.max() <= 65535


def test_opposite_bits_agree_nowhere():
    ones = torch.ones(1, 8, 64, dtype=torch.bool)
    code, inverse = packed(IrisCode(ones, ones, ones)), packed(IrisCode(~ones, ~ones, ones))
    assert best_agreement(code, inverse).score.item() == 0
    assert best_agreement(code, code).score.item() == 1


def test_scans_without_bits_that_count_agree_nowhere():
    method = LidarIris(SMALL)
    blank = SMALL(np.zeros((0, 3)), 0.0)
    assert SMALL.is_blank(blank)
    both = method.describe(np.stack([blank, SMALL(walls(0), 0.0)]))
    score = method.compare(both, both).score
    assert score.tolist() == [[0, 0], [0, 1]]
    index = index_of(method)
    index.add(both)
    assert index.search(both, 2).score.tolist() == [[0, 0], [1, 0]]


def test_the_index_finds_what_compare_finds():
    method = LidarIris(SMALL)
    places = method.describe(np.stack([SMALL(walls(k), 0.0) for k in range(14)]))
    index = index_of(method)
    assert type(index) is IrisIndex
    index.add(places[:5])
    index.add(places[5:])
    expected = method.compare(places[:3], places)
    hits = index.search(places[:3], 4)
    assert torch.equal(hits.score, expected.score.topk(4).values)
    assert torch.equal(hits.score, expected.score.gather(1, hits.place))
    assert torch.allclose(hits.turn, expected.turn.gather(1, hits.place))


def test_bad_settings_are_named():
    with pytest.raises(ConfigError, match=r"raster\.sectors: 0"):
        IrisRaster(sectors=0)
    with pytest.raises(ConfigError, match=r"preprocessing\.extent: 70 m, .* reaches to 80 m"):
        IrisRaster(preprocessing=Preprocessing())
