"""DH3D: its graph of points, published sizes, what changes a descriptor; poses by keypoints."""

import numpy as np
import pytest
import torch

from deepring.core.rigid import planar_pose, pose_from, rotation_from_rpy
from deepring.errors import ConfigError
from deepring.methods.dh3d import Dh3d, Dh3dSettings
from deepring.methods.dh3d.keypoints import consensus, mutual_matches, strongest
from deepring.methods.dh3d.point_graph import nearest_numbers, point_graph
from deepring.nn.neighbourhoods import farthest_points, interpolated, nearest_points
from deepring.rasters import PointsRaster, raster_settings
from deepring.testing import walls
from helpers.tiny_methods import TINY


def cloud(seed=0, clouds=2, n=96):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(clouds, n, 3, generator=generator) * 2 - 1


def small(**changes):
    """With batch statistics that are not the initial ones."""
    torch.manual_seed(0)
    values = {"stem": 4, "first": 6, "second": 8, "gates": (2, 3), "local": 10, "detector": (4,)}
    values |= {"features": 6, "attention": 5, "clusters": 3, "dimension": 12, "keypoints": 60}
    raster = raster_settings(PointsRaster(96))
    network = Dh3d(Dh3dSettings(**{"raster": raster, **values, **changes}))
    with torch.no_grad():
        for seed in range(3):
            network(cloud(seed + 5, 6))
    return network.eval()


def test_it_has_the_published_sizes():
    network = Dh3d()
    counts = {
        name: sum(weight.numel() for weight in getattr(network, name).parameters())
        for name in network.parts
    }
    assert counts == {"local": 172_528, "detector": 316_545, "place": 4_691_841}
    assert sum(w.numel() for w in network.place.aggregate.parameters()) == 4_293_760
    assert network.raster.shape == (8192, 3)
    assert network.descriptor_shape == (256,)


def test_a_graph_is_that_of_plain_distances():
    points = cloud() * 30
    graph = point_graph(points, neighbours=8, thinning=8)
    assert torch.equal(graph.near, nearest_points(points, points, 8))
    assert torch.equal(graph.near[..., 0], torch.arange(96).expand(2, -1))
    assert torch.equal(graph.chosen, farthest_points(points, 12))
    assert torch.equal(graph.coarse_near, nearest_points(graph.coarse, graph.coarse, 8))
    features = torch.randn(2, 12, 5, generator=torch.Generator().manual_seed(1))
    spread = graph.spread(features)
    assert torch.allclose(spread, interpolated(features, graph.coarse, points), atol=1e-5)
    # A chosen point has its own feature.
    there = spread.gather(1, graph.chosen[..., None].expand(-1, -1, 5))
    assert torch.allclose(there, features, atol=1e-5)
    assert torch.equal(graph.coarsened(spread), there)


def test_the_nearest_are_the_same_without_a_tree():
    points = cloud(3) * 30
    expected = nearest_numbers(points, points, 5)
    blocks = torch.cdist(points, points).topk(5, dim=-1, largest=False).indices
    assert torch.equal(expected, blocks)


@torch.no_grad()
def test_the_order_of_the_points_and_a_shift_change_nothing_and_a_turn_does():
    network, points = small(), cloud()
    plain = network(points)
    assert torch.allclose(plain.norm(dim=1), torch.ones(2), atol=1e-6)
    # The first point begins the farthest ones, and stays the first.
    order = torch.cat([torch.zeros(1, dtype=torch.int64), 1 + torch.randperm(95)])
    assert torch.allclose(network(points[:, order]), plain, atol=1e-5)
    assert torch.allclose(network(points + 0.01), plain, atol=1e-4)
    turned = points * torch.tensor([-1.0, -1.0, 1.0])
    assert (network(turned) - plain).abs().max() > 1e-3
    local = network.local_points(points)
    assert torch.allclose(local.descriptors.norm(dim=-1), torch.ones(2, 96), atol=1e-5)
    assert torch.allclose(local.points, points * 70.0)
    assert ((local.scores > 0) & (local.scores < 1)).all()


def test_a_scan_without_points_has_a_descriptor_and_no_pose():
    network = small()
    empty = torch.zeros(1, 96, 3)
    assert network.describe(empty).isfinite().all()
    poses = network.relative_poses(empty[0], torch.cat([empty, cloud(clouds=1)]))
    assert poses.isnan().all()
    assert network.relative_poses(cloud()[0], empty[:0]).shape == (0, 4, 4)


def test_keypoints_are_the_best_that_keep_apart():
    points = torch.tensor([[0.0, 0, 0], [0.4, 0, 0], [0.8, 0, 0], [9, 0, 0], [9, 0, 0]])
    scores = torch.tensor([0.5, 0.9, 0.5, 0.1, 0.1])
    assert strongest(points, scores, 5, apart=0.5).tolist() == [1, 3]
    assert strongest(points, scores, 5, apart=0.3).tolist() == [1, 0, 2, 3]
    assert strongest(points, scores, 2, apart=0.3).tolist() == [1, 0]


def test_matches_are_mutual():
    first, second = torch.tensor([[0.0], [4.0], [5.0]]), torch.tensor([[5.1], [0.2]])
    assert mutual_matches(first, second).tolist() == [[0, 1], [2, 0]]


@pytest.mark.parametrize("wrong", [0.0, 0.6])
def test_most_matches_decide_the_transform(wrong):
    rng = np.random.default_rng(1)
    points = rng.uniform(-30, 30, (80, 3))
    true = pose_from(rotation_from_rpy(0.05, -0.1, 2.5), [3.0, -8.0, 0.4])
    targets = points @ true[:3, :3].T + true[:3, 3] + rng.normal(0, 0.05, points.shape)
    lost = rng.random(80) < wrong
    targets[lost] = rng.uniform(-30, 30, (int(lost.sum()), 3))
    found = consensus(torch.from_numpy(points), torch.from_numpy(targets), reach=0.5)
    assert found.agreeing == pytest.approx(80 - lost.sum(), abs=2)
    assert np.abs(found.transform.numpy() - true).max() < 0.1
    assert np.abs(found.transform[:3, :3].numpy() - true[:3, :3]).max() < 0.005


def test_points_that_tell_no_transform_give_none():
    line = torch.arange(30.0)[:, None] * torch.tensor([1.0, 2.0, 0.0])
    assert consensus(line, line, reach=0.5) is None
    assert consensus(line[:2], line[:2], reach=0.5) is None
    assert consensus(torch.zeros(9, 3), torch.zeros(9, 3), reach=0.5) is None


def test_a_transform_that_carries_none_of_its_own_matches_is_none():
    triangle = torch.tensor([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [4.5, 7.794, 0.0]])
    larger = triangle * (1 + 1.9 / 9.0)  # sides differ by less than 2 m, corners by 1.1 m
    assert consensus(triangle, larger, 1.0) is None
    assert consensus(triangle, larger, 1.2) is not None


def test_a_pose_carries_the_places_points_onto_the_querys():
    network = small(agreeing=4)
    raster = network.raster
    place = torch.from_numpy(raster(walls(2), 0.0))[None].float()
    # Features are of the frame, so that a shift is found, and the opposite one is not.
    true = planar_pose(4.0, -2.0, 0.0)
    query = place + torch.tensor([4.0, -2.0, 0.0]) / raster.extent
    poses = network.relative_poses(query[0], torch.cat([place, query]))
    assert poses.dtype == torch.float64
    assert np.abs(poses[0].numpy() - true).max() < 0.05
    assert np.abs(poses[1].numpy() - np.eye(4)).max() < 1e-4
    again = network.relative_poses(query[0], torch.cat([place, query]))
    assert torch.equal(again, poses)


def test_settings_that_mean_nothing_are_refused():
    for changes, complaint in (
        ({"gates": (3,)}, r"dh3d\.gates: \[3\], expected two numbers"),
        ({"thinning": 16}, r"dh3d\.thinning: 16 leaves 6 of 96 points, expected at least"),
        ({"agreeing": 2}, r"dh3d\.agreeing: 2"),
        ({"reach": 0.0}, r"dh3d\.reach: 0"),
        ({"neighbours": 0}, r"dh3d\.neighbours: 0"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            small(**changes)


def test_training_statistics_stay_when_keypoints_are_made():
    network = TINY["dh3d"]()
    network.train()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    network.keypoints(cloud(n=network.raster.shape[0]))
    assert network.training
    assert all(torch.equal(before[name], value) for name, value in network.state_dict().items())
    assert network(cloud(n=network.raster.shape[0])).isfinite().all()
