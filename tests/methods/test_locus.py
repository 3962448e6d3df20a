"""Locus: the worked examples of its pooling, its network's size, scans of few segments, a drive."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import planar_pose, turn_points
from deepring.errors import ConfigError, DataError
from deepring.methods.locus import Locus, LocusSettings
from deepring.methods.locus.pooling import (
    descriptor_of,
    nearest_weights,
    pooled_neighbours,
    power_normalised,
    second_order,
)
from deepring.methods.locus.segment_network import SegmentNetwork
from deepring.methods.locus.temporal import describe_drive, links_to, pooled_over_time
from deepring.methods.method import index_of
from deepring.rasters import BevRaster, SegmentsRaster, raster_settings
from deepring.testing import check_method

RASTER = SegmentsRaster(
    max_segments=12, cells=(8, 8, 4), tolerance=0.6, least_points=20, most_points=500
)


def small(seed=0, **values):
    torch.manual_seed(seed)
    values = {"channels": (2, 4, 4), "hidden": 16, "feature": 16, "least_segments": 3, **values}
    return Locus(LocusSettings(raster_settings(RASTER), **values)).eval()


def things(seed=0, number=9):
    """Lumps of different sizes that stand apart, metres: (n, 3) float32."""
    rng = np.random.default_rng(seed)
    azimuth = np.arange(number) * 2 * np.pi / number + rng.uniform(0, 0.3, number)
    range_ = rng.uniform(8, 30, number)
    parts = []
    for a, r in zip(azimuth, range_, strict=True):
        size, count = rng.uniform(0.15, 0.4, 3), rng.integers(40, 200)
        lump = rng.uniform(-1, 1, (count, 3)) * size * [1, 2, 2]
        parts.append(lump + np.array([r * np.cos(a), r * np.sin(a), 2.0]))
    return np.concatenate(parts).astype(np.float32)


def rasters(*scans):
    return torch.from_numpy(np.stack([RASTER(scan, 0.0) for scan in scans]))


def row(*values):
    return torch.tensor([values], dtype=torch.float32)


def test_worked_examples_of_the_second_order():
    eye = torch.eye(2)[None]
    swapped = eye.flip(1)  # each the other's only neighbour
    apart = torch.tensor([[[0.0, 3.0], [3.0, 0.0]]])
    assert torch.equal(pooled_neighbours(eye, apart), swapped)
    half = math.sqrt(0.5)
    assert torch.allclose(descriptor_of(eye, swapped), row(0, half, half, 0), atol=1e-6)
    one = descriptor_of(torch.tensor([[[3.0, 1.0]]]), torch.tensor([[[2.0, 1.0]]]))
    assert torch.allclose(one, row(0.63246, 0.31623, 0.63246, 0.31623), atol=1e-5)
    matrix = torch.tensor([[[2.0, 1.0], [1.0, 2.0]]])
    normalised = torch.tensor([[[1.36603, 0.36603], [0.36603, 1.36603]]])
    assert torch.allclose(power_normalised(matrix), normalised, atol=1e-5)
    # The power is of singular values: that of entries would be another matrix.
    assert not torch.allclose(matrix.sqrt(), normalised, atol=0.02)
    rows = torch.nn.functional.normalize(power_normalised(matrix), dim=2).flatten(1)
    whole = torch.nn.functional.normalize(rows, dim=1)
    assert torch.allclose(whole, row(0.68301, 0.18301, 0.18301, 0.68301), atol=1e-5)


def test_weights_of_neighbours_fall_with_their_distance():
    weights = nearest_weights(torch.tensor([2.0, 5.0, 10.0]))
    assert torch.allclose(weights, torch.tensor([0.45659, 0.33825, 0.20516]), atol=1e-5)
    assert nearest_weights(torch.full((2, 3), torch.inf)).eq(0).all()


def test_only_the_nearest_neighbours_count_and_none_is_its_own():
    rng = np.random.default_rng(0)
    places = rng.uniform(-20, 20, (7, 2))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    features = rng.uniform(0, 1, (7, 4))
    found = pooled_neighbours(
        torch.from_numpy(features)[None].float(), torch.from_numpy(apart)[None].float(), 3
    )[0].numpy()
    for k in range(7):
        near = [m for m in np.argsort(apart[k]) if m != k][:3]
        weights = np.exp(-0.1 * apart[k, near])
        assert np.allclose(found[k], weights @ features[near] / weights.sum(), atol=1e-5)
    alone = pooled_neighbours(torch.ones(1, 1, 4), torch.zeros(1, 1, 1))
    assert alone.eq(0).all()


def test_the_second_order_is_that_of_a_loop():
    f, g = torch.rand(2, 5, 3), torch.rand(2, 5, 3)
    found = second_order(f, g)
    for b in range(2):
        expected = torch.zeros(3, 3)
        for s in range(5):
            expected = torch.maximum(expected, torch.outer(f[b, s], g[b, s]))
        assert torch.allclose(found[b].float(), expected)


def test_features_that_no_segment_has_stay_zeros():
    f, g = torch.rand(1, 8, 5), torch.rand(1, 8, 5)
    f[..., 1] = 0
    g[..., 3] = 0
    matrix = descriptor_of(f, g).view(5, 5)
    assert matrix.isfinite().all()
    assert matrix[1].eq(0).all()
    assert matrix[:, 3].abs().max() < 1e-6
    assert float(matrix.norm()) == pytest.approx(1)
    assert descriptor_of(torch.zeros(1, 8, 5), g).eq(0).all()


def test_the_published_network_has_segmaps_parameters():
    with torch.device("meta"):
        network = SegmentNetwork()
        method = Locus()
    assert sum(p.numel() for p in network.parameters()) == 8_591_424
    assert sum(p.numel() for p in method.parameters()) == 8_591_424
    assert method.descriptor_shape == (4096,)


def test_features_of_many_segments_are_those_of_each():
    network = SegmentNetwork((8, 8, 4), (2, 4, 4), 8, 6).eval()
    voxels, extents = (torch.rand(130, 8, 8, 4) < 0.2).to(torch.uint8), torch.rand(130, 3) * 9
    with torch.no_grad():
        lots = network(voxels, extents)
        singly = torch.cat(
            [network(v[None], e[None]) for v, e in zip(voxels, extents, strict=True)]
        )
    assert lots.min() >= 0
    assert torch.allclose(lots, singly, atol=1e-5)


def test_locus_has_what_every_method_has():
    method = small()
    images = rasters(*(things(k) for k in range(6)))
    assert check_method(method, images).keys() == {"turn"}
    assert type(index_of(method)).__name__ == "VectorIndex"


@pytest.mark.parametrize("turn", [0.5, 2.8])
def test_a_turn_of_the_scan_leaves_the_descriptor_but_for_the_voxels(turn):
    method = small()
    scan, other = things(1), things(2)
    d = method.describe(rasters(scan, turn_points(scan, turn), other))
    same, different = (float(method.compare(d[:1], d[k : k + 1]).score) for k in (1, 2))
    assert same > 0.98
    assert same > different


def test_the_order_of_segments_makes_no_difference():
    method, image = small(), rasters(things(3))
    segments = method.segments(image)
    count = int(segments.present.sum())
    order = torch.arange(12)
    order[:count] = torch.randperm(count, generator=torch.Generator().manual_seed(0))
    moved = segments._replace(
        bits=segments.bits[:, order],
        extents=segments.extents[:, order],
        distances=segments.distances[:, order][..., order],
    )
    with torch.no_grad():
        f, g = method.features(segments), method.features(moved)
        first = descriptor_of(f, pooled_neighbours(f, segments.distances))
        second = descriptor_of(g, pooled_neighbours(g, moved.distances))
    assert torch.allclose(first, second, atol=1e-4)


def test_scans_of_too_few_segments_have_zeros_and_are_like_nothing():
    method = small(least_segments=5)
    few, many = things(0, number=4), things(0, number=6)
    d = method.describe(rasters(few, many, np.zeros((0, 3), np.float32)))
    assert d[0].eq(0).all()
    assert d[2].eq(0).all()
    assert float(d[1].norm()) == pytest.approx(1, abs=1e-5)
    score = method.compare(d, d).score
    assert score[0].eq(0).all()
    assert float(score[1, 1]) == pytest.approx(1, abs=1e-5)


def test_settings_that_make_no_network_are_refused():
    with pytest.raises(ConfigError, match=r"locus\.channels: \[2, 2\], expected three"):
        small(channels=(2, 2))
    with pytest.raises(ConfigError, match=r"locus\.least_segments: 0"):
        small(least_segments=0)
    with pytest.raises(ConfigError, match=r"Locus, spatial: raster"):
        Locus(LocusSettings(raster_settings(BevRaster())))


def test_a_segment_is_linked_where_feature_and_place_agree():
    before = torch.eye(6)
    centres = np.arange(6)[:, None] * np.array([[3.0, 0, 0]])
    features = before[[2, 5, 0]] + 0.01
    places = centres[[2, 5, 0]] + [[0.5, 0, 0], [2.5, 0, 0], [0, 1.9, 0]]
    assert links_to(features, places, before, centres).tolist() == [2, -1, 0]
    # In place, but five others are more alike.
    assert links_to(before[:1] * 0 + 1.0, centres[:1], before[1:] * 9, centres[1:]).tolist() == [-1]
    # Of two in place the first counts, unless the other is nearer in both.
    near = np.array([[0.5, 0, 0], [0.2, 0, 0]])
    alike = torch.tensor([[1.0, 0.1], [1.0, 0.0]])
    assert links_to(torch.tensor([[1.0, 0.0]]), np.zeros((1, 3)), alike, near).tolist() == [1]
    assert links_to(torch.tensor([[1.0, 0.2]]), np.zeros((1, 3)), alike, near).tolist() == [0]
    assert links_to(before[:0], centres[:0], before, centres).tolist() == []
    assert links_to(before, centres, before[:0], centres[:0]).tolist() == [-1] * 6


def test_pooling_over_time_by_hand():
    own = torch.tensor([3.0, 0.0])
    assert torch.equal(pooled_over_time(own, []), own)
    earlier = [torch.tensor([3.0, 4.0]), torch.tensor([3.0, 0.0])]  # 4 and 0 away
    w = math.exp(-0.4) / (1 + math.exp(-0.4))
    expected = own + w * earlier[0] + (1 - w) * earlier[1]
    assert torch.allclose(pooled_over_time(own, earlier), expected)


def test_a_drive_is_described_as_published():
    method = small()
    scan = things(4)
    poses = np.stack([planar_pose(0.3 * k, 0, 0.1 * k) for k in range(5)])
    world, rng = scan.astype(np.float64), np.random.default_rng(0)
    scans = []  # each shows other points of the same things
    for pose in poses:
        points = (world - pose[:3, 3]) @ pose[:3, :3]
        scans.append(points[rng.random(len(points)) < 0.7].astype(np.float32))
    images = rasters(*scans)
    drive = describe_drive(method, images, poses)
    assert drive.shape == (5, 256)
    assert torch.allclose(drive.norm(dim=1), torch.ones(5), atol=1e-5)
    # The first scan: own features stand for what was before.
    segments = method.segments(images[:1])
    with torch.no_grad():
        f = method.features(segments)
        first = descriptor_of(f, (pooled_neighbours(f, segments.distances) + f) / 2)
    assert torch.allclose(drive[:1], first, atol=1e-4)
    # Only the three scans before count, and they do.
    assert torch.allclose(describe_drive(method, images[1:], poses[1:])[3], drive[4], atol=1e-5)
    assert not torch.allclose(describe_drive(method, images[2:], poses[2:])[2], drive[4], atol=1e-6)
    # Wrong poses link nothing; another world's origin changes nothing.
    alone = describe_drive(method, images, poses, previous=0)
    astray = poses.copy()
    astray[:, 0, 3] *= 100
    assert torch.allclose(describe_drive(method, images, astray), alone, atol=1e-5)
    elsewhere = planar_pose(700, -20, 2.0) @ poses
    assert torch.allclose(describe_drive(method, images, elsewhere), drive, atol=1e-4)


def test_a_drive_of_another_shape_is_refused():
    method, images = small(), rasters(things(0), things(1))
    with pytest.raises(DataError, match=r"poses: shape \(3, 4, 4\), expected \(2, 4, 4\)"):
        describe_drive(method, images, np.tile(np.eye(4), (3, 1, 1)))
    with pytest.raises(DataError, match="rasters"):
        describe_drive(method, images[:, :3], np.tile(np.eye(4), (2, 1, 1)))
    assert describe_drive(method, images[:0], np.zeros((0, 4, 4))).shape == (0, 256)
    assert method.training is False
