"""LPD-Net: its published size, its layers one by one, the order of the points, settings."""

import json

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from deepring.core.equivariance import relative_error
from deepring.errors import ConfigError, DeepringError
from deepring.methods.lpdnet import LpdNet, LpdNetSettings
from deepring.methods.method import Method
from deepring.rasters import PointFeaturesRaster, PointsRaster, make_raster, raster_settings
from deepring.testing import walls
from helpers.scenes import scattered


def small(**changes):
    values = {
        "raster": raster_settings(PointFeaturesRaster(count=64)),
        "first": (8, 8),
        "graph": (8, 8),
        "spatial": (8, 8),
        "second": (8, 16),
        "neighbours": 5,
        "transform_widths": (8, 16),
        "transform_hidden": (8,),
        "clusters": 4,
        "dimension": 12,
    }
    return LpdNetSettings(**{**values, **changes})


def network(**changes):
    """With T-Nets off the identity and batch statistics off the initial ones."""
    torch.manual_seed(0)
    net = LpdNet(small(**changes))
    with torch.no_grad():
        net.align_points.last.weight.normal_(0, 0.3)
        if net.align_features is not None:
            net.align_features.last.weight.normal_(0, 0.1)
        for seed in range(3):
            net(clouds(8, seed + 20))
    return net.eval()


def clouds(n=4, seed=9):
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(n, 64, 3, generator=generator) * 2 - 1
    return torch.cat([points, torch.rand(n, 64, 10, generator=generator)], dim=-1)


def test_the_published_size():
    settings = LpdNetSettings()
    assert make_raster(settings.raster) == PointFeaturesRaster(count=4096, extent=70.0)
    net = LpdNet(settings)
    assert isinstance(net, Method)
    assert net.descriptor_shape == (256,)
    # Published: 19 806 281, with a bias before each batch norm, which that norm takes away again.
    idle = 2 * (64 + 128 + 1024 + 512 + 256) + 2 * (64 + 64)
    assert sum(p.numel() for p in net.parameters()) == 19_806_281 - idle


@torch.no_grad()
def test_descriptors_are_those_of_its_layers_one_after_the_other():
    net, rasters = network(), clouds(2)
    for raster, expected in zip(rasters, net(rasters), strict=True):
        points, features = raster[:, :3], raster[:, 3:]
        transform = net.align_points(points.T[None])[0]
        x = net.first(torch.cat([points @ transform, features], dim=1).T[None])
        space = (x[0].T @ net.align_features(x)[0]).double()
        x = net.graph(x.transpose(1, 2), neighbours(space))
        x = net.spatial(x, neighbours(points.double()))  # as they are given, not transformed
        x = F.normalize(net.second(x.transpose(1, 2)).transpose(1, 2), dim=-1)
        assert torch.allclose(F.normalize(net.aggregate(x), dim=-1)[0], expected, atol=1e-5)


def neighbours(space):
    return torch.cdist(space, space).sort(dim=-1).indices[None, :, :5]


def test_the_order_of_the_points_changes_nothing():
    net = network()
    plain = net.describe(clouds())
    assert plain.dtype == torch.float32
    assert torch.allclose(plain.norm(dim=1), torch.ones(4), atol=1e-6)
    for seed in range(3):
        order = torch.randperm(64, generator=torch.Generator().manual_seed(seed))
        assert relative_error(net.describe(clouds()[:, order]), plain) < 1e-5
    assert relative_error(net.describe(clouds(seed=10)), plain) > 1e-3


def test_from_a_scan_in_any_order_to_the_same_descriptor():
    net, points = network(), scattered(0)
    shuffled = np.random.default_rng(0).permutation(points)
    one, other = (
        net.describe(torch.from_numpy(net.raster(p, 0.0))[None]) for p in (points, shuffled)
    )
    assert torch.equal(one, other)


def test_a_turn_of_the_scan_does_and_so_do_features():
    net, rasters = network(), clouds()
    turned = net.raster.turned(rasters, torch.tensor([180] * 4))
    assert relative_error(net.describe(turned), net.describe(rasters)) > 1e-3
    other = torch.cat([rasters[..., :3], 1 - rasters[..., 3:]], dim=-1)
    assert relative_error(net.describe(other), net.describe(rasters)) > 1e-3
    blind = network(use_features=False)
    assert relative_error(blind.describe(other), blind.describe(rasters)) == 0


def test_the_transform_of_the_features_chooses_neighbours_and_learns_nothing():
    net = network().train()
    (net(clouds()) * torch.randn(4, 12)).sum().backward()
    for name, parameter in net.named_parameters():
        chooses = name.startswith("align_features.")
        assert parameter.requires_grad != chooses
        assert (parameter.grad is None) == chooses, name
        assert chooses or parameter.grad.abs().sum() > 0, name
    fresh = LpdNet(small()).eval()  # which begins as the identity
    without = LpdNet(small(align_features=False)).eval()
    shared = {k: v for k, v in fresh.state_dict().items() if not k.startswith("align_features.")}
    without.load_state_dict(shared)
    assert torch.equal(without.describe(clouds()), fresh.describe(clouds()))
    assert not torch.equal(net.eval().describe(clouds()), fresh.describe(clouds()))


def test_scans_of_few_points_and_of_none_are_described():
    net = network()
    scans = [walls(0)[:3], walls(1)[:40], walls(2)[:0], walls(3)]
    images = torch.from_numpy(np.stack([net.raster(points, 0.0) for points in scans]))
    descriptors = net.describe(images)
    assert torch.isfinite(descriptors).all()
    one = torch.cat([net.describe(image[None]) for image in images])
    assert relative_error(one, descriptors) < 1e-5


def test_scores_are_negative_distances_and_there_is_no_yaw():
    net = network()
    queries, database = net.describe(clouds(3)), net.describe(clouds(5, seed=10))
    score, turn = net.compare(queries, database)
    assert turn is None
    expected = -(queries[:, None] - database[None]).norm(dim=-1)
    assert torch.allclose(score, expected, atol=1e-6)


def test_settings_travel_as_plain_values():
    settings = small(gating=False)
    values = json.loads(json.dumps(settings.to_dict()))
    assert LpdNetSettings.from_dict(values) == settings
    twin = LpdNet(LpdNetSettings.from_dict(values))
    twin.load_state_dict(network(gating=False).state_dict())
    assert torch.equal(twin.describe(clouds()), network(gating=False).describe(clouds()))


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"raster": raster_settings(PointsRaster())}, r"LPD-Net: raster: a PointsRaster, expected"),
        ({"neighbours": 65}, r"lpdnet\.neighbours: 65, expected at most the raster's count of 64"),
        ({"neighbours": 0}, r"lpdnet\.neighbours: 0"),
        ({"graph": ()}, r"lpdnet\.graph: \[\]"),
        ({"clusters": 0}, r"netvlad\.clusters: 0"),
    ],
)
def test_bad_settings_are_named(changes, complaint):
    with pytest.raises(ConfigError, match=complaint):
        LpdNet(small(**changes))
    with pytest.raises(DeepringError, match=r"settings\.cluster_size: unknown"):
        LpdNetSettings.from_dict({"cluster_size": 64})
