"""PointNetVLAD from points to distances: the order of the points, the norm, settings."""

import json

import numpy as np
import pytest
import torch

from deepring.core.equivariance import relative_error
from deepring.errors import DeepringError
from deepring.methods.method import Method
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.rasters import BevRaster, PointsRaster, make_raster, raster_settings
from helpers.scenes import scattered


def small(**changes):
    values = {
        "raster": raster_settings(PointsRaster(count=64)),
        "first": (8, 8),
        "second": (8, 16),
        "transform_widths": (8, 16),
        "transform_hidden": (8,),
        "clusters": 4,
        "dimension": 12,
    }
    return PointNetVladSettings(**{**values, **changes})


def network(**changes):
    """With T-Nets off the identity and batch statistics off the initial ones."""
    torch.manual_seed(0)
    net = PointNetVlad(small(**changes))
    with torch.no_grad():
        net.features.align_points.last.weight.normal_(0, 0.3)
        net.features.align_features.last.weight.normal_(0, 0.1)
        for seed in range(3):
            net(clouds(8, seed + 20))
    return net.eval()


def clouds(n=4, seed=9):
    points = torch.rand(n, 64, 3, generator=torch.Generator().manual_seed(seed)) * 2 - 1
    return points.half()


def test_it_is_a_method_of_4096_points_and_256_numbers():
    settings = PointNetVladSettings()
    assert make_raster(settings.raster) == PointsRaster(count=4096, extent=70.0)
    net = PointNetVlad(small())
    assert isinstance(net, Method)
    assert net.raster == PointsRaster(count=64)
    assert settings.clusters == 64
    assert settings.dimension == 256


def test_descriptors_have_unit_norm_and_full_precision():
    descriptors = network().describe(clouds())
    assert descriptors.shape == (4, 12)
    assert descriptors.dtype == torch.float32
    assert torch.allclose(descriptors.norm(dim=1), torch.ones(4), atol=1e-6)


@torch.no_grad()
def test_features_are_aggregated_at_unit_norm():
    net = network()
    features = net.features(clouds().float())
    features = features / features.norm(dim=-1, keepdim=True)
    vector = net.aggregate(features)
    assert torch.allclose(net(clouds()), vector / vector.norm(dim=1, keepdim=True), atol=1e-6)


def test_the_order_of_the_points_changes_nothing():
    net = network()
    plain = net.describe(clouds())
    for seed in range(3):
        order = torch.randperm(64, generator=torch.Generator().manual_seed(seed))
        assert relative_error(net.describe(clouds()[:, order]), plain) < 1e-5
    assert relative_error(net.describe(clouds(seed=10)), plain) > 1e-2


def test_a_turn_of_the_scan_does():
    net, points = network(), clouds()
    turned = points * torch.tensor([-1.0, -1.0, 1.0], dtype=torch.half)
    assert relative_error(net.describe(turned), net.describe(points)) > 1e-2


def test_from_a_scan_in_any_order_to_the_same_descriptor():
    net, points = network(), scattered(0)
    shuffled = np.random.default_rng(0).permutation(points)
    one, other = (
        net.describe(torch.from_numpy(net.raster(p, 0.0))[None]) for p in (points, shuffled)
    )
    assert torch.equal(one, other)


def test_scores_are_negative_distances_and_there_is_no_yaw():
    net = network()
    queries, database = net.describe(clouds(3)), net.describe(clouds(5, seed=10))
    score, turn = net.compare(queries, database)
    assert turn is None
    for i in range(3):
        for j in range(5):
            distance = (queries[i] - database[j]).norm().item()
            assert score[i, j].item() == pytest.approx(-distance, abs=1e-6)
    itself = net.compare(queries, queries).score
    assert torch.equal(itself.argmax(dim=1), torch.arange(3))
    assert itself.diagonal().abs().max() == 0


def test_describing_leaves_training_mode_and_statistics_alone():
    net = network().train()
    before = {name: value.clone() for name, value in net.state_dict().items()}
    descriptors = net.describe(clouds())
    assert net.training
    assert not descriptors.requires_grad
    assert all(torch.equal(before[name], value) for name, value in net.state_dict().items())
    assert torch.equal(descriptors, net.eval().describe(clouds()))


def test_every_parameter_takes_part():
    net = network().train()
    (net(clouds()) * torch.randn(4, 12)).sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())


def test_settings_travel_as_plain_values():
    settings = small(gating=False)
    values = json.loads(json.dumps(settings.to_dict()))
    assert PointNetVladSettings.from_dict(values) == settings
    twin = PointNetVlad(PointNetVladSettings.from_dict(values))
    twin.load_state_dict(network(gating=False).state_dict())
    assert torch.equal(twin.describe(clouds()), network(gating=False).describe(clouds()))


def test_bad_settings_are_named():
    with pytest.raises(DeepringError, match=r"settings\.cluster_size: unknown"):
        PointNetVladSettings.from_dict({"cluster_size": 64})
    with pytest.raises(DeepringError, match=r"PointNetVLAD: raster: a BevRaster, expected"):
        PointNetVlad(small(raster=raster_settings(BevRaster())))
    with pytest.raises(DeepringError, match=r"netvlad\.clusters: 0"):
        PointNetVlad(small(clusters=0))
