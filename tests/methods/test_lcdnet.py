"""LCDNet: the card's figures of its parts, its size, and poses of scans that were moved."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from deepring.core.rigid import moved_points, pose_from, rotation_from_rpy
from deepring.errors import ConfigError, DataError
from deepring.methods.lcdnet import LcdNet, LcdNetSettings
from deepring.methods.lcdnet.backbone import Backbone, voxels
from deepring.methods.lcdnet.keypoints import BallFeatures, from_above
from deepring.methods.lcdnet.pose_head import PoseHead, unbalanced_transport
from deepring.nn.balls import rows_in_balls
from deepring.nn.sparse import SparseTensor
from deepring.nn.sparse_grid import Grid
from deepring.rasters import raster_settings
from deepring.testing import walls
from helpers.tiny_methods import MEANS, lcdnet

CORNER, SIZE, EXTENT = (-3.0, -4.0, -1.0), 0.5, (12, 16, 24)


def scans(seeds):
    return torch.from_numpy(np.stack([MEANS(walls(k), 0.0) for k in seeds]))


def test_the_published_size_has_the_published_number_of_parameters():
    network = LcdNet.without_weights(LcdNetSettings())
    parts = {
        name: sum(p.numel() for p in part.parameters()) for name, part in network.named_children()
    }
    assert parts == {
        "backbone": 711_872,
        "balls": 41_120,
        "fusion": 410_880,
        "aggregation": 10_634_368,
        "pose_head": 2,
    }
    assert network.backbone.layers == 2
    assert network.fusion[0].in_features == 640
    assert network.descriptor_shape == (256,)


def test_the_transport_of_three_features():
    features = torch.eye(3, dtype=torch.float64)[None]
    transport = unbalanced_transport(1 - features @ features.mT, 1.03, 1.0, 5)[0]
    assert transport.diagonal().numpy() == pytest.approx([0.33391] * 3, abs=1e-5)
    assert transport[0, 1:].numpy() == pytest.approx([0.12647] * 2, abs=1e-5)
    assert transport.sum(dim=1).numpy() == pytest.approx([0.58685] * 3, abs=1e-5)
    assert float(transport.sum()) > 1  # it may send more than it has, unlike balanced transport
    assert float(unbalanced_transport(1 - features @ features.mT, 1.03, 1e6, 50).sum()) <= 1 + 1e-5


def test_the_pose_of_three_points():
    points = torch.diag(torch.tensor([1.0, 2.0, 3.0]))[None]
    turn = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    shift = torch.tensor([5.0, 1, 0])
    features = torch.eye(3)[None]
    matches = PoseHead()(points, features, points @ turn.T + shift, features)
    assert matches.matched[0, 0].tolist() == pytest.approx([4.56899, 1.56899, 0.64652], abs=1e-5)
    assert torch.allclose(matches.transforms[0, :3, :3], turn.double(), atol=1e-6)
    assert torch.allclose(matches.transforms[0, :3, 3], shift.double(), atol=1e-5)
    assert matches.told.all()


def test_the_transport_at_its_ends():
    """Sharp costs of points that must send all give a permutation."""
    order = torch.tensor([2, 0, 3, 1])
    cost = 1 - torch.eye(4, dtype=torch.float64)[order][None]
    sharp = unbalanced_transport(cost, 0.03, 1e6, 200)[0]
    assert torch.allclose(sharp, torch.eye(4, dtype=torch.float64)[order] / 4, atol=1e-6)
    costs = torch.rand(5, 6, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) * 2
    sent = unbalanced_transport(costs, 0.5, 1e6, 200)
    assert torch.allclose(sent.sum(dim=2), torch.full((5, 6), 1 / 6).double(), atol=1e-4)
    assert torch.allclose(sent.sum(dim=1), torch.full((5, 4), 1 / 4).double(), atol=1e-4)
    # With a small γ a point that is like no other sends less.
    costs[:, 0] = 2.0
    sent = unbalanced_transport(costs, 0.1, 0.5).sum(dim=2)
    assert (sent[:, :1] < sent[:, 1:]).all()


def test_the_head_learns_by_gradients_that_are_finite():
    head, generator = PoseHead(), torch.Generator().manual_seed(0)
    points = torch.randn(2, 8, 3, generator=generator)
    features = torch.randn(2, 8, 4, generator=generator, requires_grad=True)
    # The same points and features twice: no rotation at all, and equal costs.
    matches = head(points, features, points, features)
    matches.transforms.square().sum().backward()
    for value in (features, head.log_epsilon, head.log_gamma):
        assert torch.isfinite(value.grad).all()
    assert float(head.epsilon.detach()) == pytest.approx(1.03)


def test_voxels_are_means_of_what_lies_in_them():
    points = torch.tensor([[[-2.9, -3.9, -0.9, 1.0], [-2.7, -3.7, -0.7, 0.0], [9, 0, 0, 1]]])
    filled = torch.tensor([[True, True, True]])
    x = voxels(points, filled, CORNER, SIZE, EXTENT)
    assert x.coordinates.tolist() == [[0, 0, 0, 0]]  # the last point is outside
    assert torch.allclose(x.features, torch.tensor([[-2.8, -3.8, -0.8, 0.5]]))
    assert x.grid.extent == (12, 16, 25)
    with pytest.raises(DataError, match="voxels in the scans"):
        voxels(points.repeat(2, 1, 1), torch.stack([filled[0], ~filled[0]]), CORNER, SIZE, EXTENT)


def dense_of(module, image):
    """What a layer of the backbone does to a dense image, at its sites and elsewhere."""
    conv, norm = module.conv, module.norm.norm
    kernel = getattr(conv, "kernel", 3)
    sizes = (kernel,) * 3 if isinstance(kernel, int) else kernel
    weight = conv.weight.permute(2, 1, 0).unflatten(2, sizes)
    stride, padding = getattr(conv, "stride", 1), getattr(conv, "padding", 1)
    out = F.conv3d(image, weight, stride=stride, padding=padding)
    return F.batch_norm(
        out, norm.running_mean, norm.running_var, norm.weight, norm.bias, eps=norm.eps
    ).relu()


def test_on_a_full_block_the_backbone_is_the_dense_network():
    """Where every site is occupied, submanifold convolutions are the dense ones."""
    torch.manual_seed(0)
    backbone = Backbone(2, (3, 4, 5, 6, 7), 24, 0.1).double().eval()
    with torch.no_grad():
        for name, value in backbone.named_parameters():
            value.mul_(3 if "conv" in name else 1)
    sites = torch.ones(1, 8, 8, 25).nonzero()
    x = torch.randn(len(sites), 2, dtype=torch.float64)
    levels, above = backbone(SparseTensor.of(x, sites, extent=(8, 8, 25)))
    image = torch.zeros(1, 8, 8, 25, 2, dtype=torch.float64)
    image[tuple(sites.T)] = x
    image = image.movedim(-1, 1)
    layers = [*backbone.stem, *(layer for stage in backbone.stages for layer in stage)]
    for layer in [*layers, backbone.last]:
        image = dense_of(layer, image)
    assert tuple(image.shape[2:]) == above.grid.extent == (1, 1, 1)
    assert above.features.abs().max() > 0.1
    assert torch.allclose(above.features, image[0, :, 0, 0].mT, atol=1e-9)
    assert [level.features.stride for level in levels] == [1, 2, 4, 8]


def test_sites_stand_in_the_middle_of_what_their_kernels_see():
    """A lone voxel: the mean of the sites that see it, weighted by nothing, is around it."""
    backbone = Backbone(1, (2, 2, 2, 2, 2), 24, 0.1)
    x = SparseTensor.of(torch.ones(1, 1), torch.tensor([[0, 8, 8, 12]]), extent=(32, 32, 25))
    levels, _ = backbone.eval()(x)
    where = torch.tensor([8.5, 8.5, 12.5])
    for level, reach in zip(levels, (0, 1, 3, 7), strict=True):
        middles = level.middles((0.0, 0.0, 0.0), 1.0)
        assert (middles - where).abs().max() <= reach
    # Without padding along z the last level begins a site higher.
    assert levels[-1].first == (0.5, 0.5, 4.5)


def test_rows_of_sites_are_found_anywhere():
    sites = torch.tensor([[0, 1, 2, 3], [1, 0, 0, 0], [0, 5, 2, 1]])
    grid = Grid(sites)
    asked = torch.tensor([[0, 5, 2, 1], [0, 5, 2, 2], [2, 0, 0, 0], [0, -9, 2, 3], [1, 0, 0, 0]])
    rows = grid.rows(asked).tolist()
    assert [k >= 0 for k in rows] == [True, False, False, False, True]
    assert grid.coordinates[[rows[0], rows[4]]].tolist() == [[0, 5, 2, 1], [1, 0, 0, 0]]


def test_the_view_from_above_is_torchs_bilinear_sampling():
    generator = torch.Generator().manual_seed(0)
    full = torch.rand(2, 6, 5, 2, generator=generator) < 0.6
    full[:, 0, 0, 0] = True
    sites = full.nonzero()
    x = torch.randn(len(sites), 3, generator=generator)
    places = torch.rand(2, 9, 2, generator=generator) * torch.tensor([8.0, 7.0]) - 1.5
    ours = from_above(SparseTensor.of(x, sites), 2, places)
    image = torch.zeros(2, 6, 5, 2, 3)
    image[tuple(sites.T)] = x
    image = image.flatten(3).permute(0, 3, 2, 1)  # (b, channel, y, x)
    scaled = places * (2 / torch.tensor([5.0, 4.0])) - 1
    theirs = F.grid_sample(image, scaled[:, None], align_corners=True, padding_mode="zeros")
    assert torch.allclose(ours, theirs[:, :, 0].mT, atol=1e-5)


def test_ball_features_are_the_largest_over_what_lies_around():
    torch.manual_seed(0)
    balls = BallFeatures(2, 4, (1.0, 2.0), (3, 50), 0.1).eval()
    centres, points = torch.randn(2, 5, 3) * 2, torch.randn(30, 3) * 2
    features = torch.randn(30, 2)
    found = balls(centres, points, features, [20, 10])
    assert found.shape == (2, 5, 8)
    for k, start, size in ((0, 0, 20), (1, 20, 10)):
        for centre, row in zip(centres[k], found[k], strict=True):
            part = points[start : start + size]
            near = ((part - centre).norm(dim=1) <= 2.0).nonzero()[:, 0] + start
            rows = torch.cat([points[near] - centre, features[near]], dim=1)
            rows = rows if len(near) else torch.zeros(1, 5)
            assert torch.allclose(row[4:], balls.perceptrons[1](rows).amax(dim=0), atol=1e-5)
    assert (rows_in_balls(centres + 100, points, [20, 10], 1.0, 3) == -1).all()


def test_descriptors_have_unit_norm_and_do_not_depend_on_the_order_of_the_other_points():
    network, images = lcdnet().eval(), scans([0, 1])
    vectors = network.describe(images)
    assert torch.allclose(vectors.norm(dim=1), torch.ones(2))
    filled = int((images[0, :, 0] != -32768).sum())
    order = torch.arange(images.shape[1])
    k = MEANS.keypoints
    order[k:filled] = k + torch.randperm(filled - k)
    assert torch.allclose(network.describe(images[:, order]), vectors, atol=1e-5)


def test_a_scan_without_points_and_one_with_a_single_point_are_described():
    network = lcdnet().eval()
    empty = MEANS(np.zeros((0, 3), np.float32), 0.0)
    lone = MEANS(np.float32([[3, 4, 1]]), 0.0)
    images = torch.from_numpy(np.stack([empty, lone]))
    assert torch.isfinite(network.describe(images)).all()
    assert network.relative_poses(images[0], images).isnan().all()
    assert network.describe(images[:0]).shape == (0, 8)
    assert network.relative_poses(images[1], images[:0]).shape == (0, 4, 4)


def oracle(network):
    """A network whose keypoints' features say which point of the first cloud they are."""
    basis = torch.eye(MEANS.keypoints)

    def encode(images):
        points, _ = MEANS.in_metres(images)
        kind = type(LcdNet.encode(network, images))
        features = basis.expand(len(images), -1, -1)
        return kind(torch.zeros(len(images), 8), points[:, : MEANS.keypoints, :3], features)

    network.encode = encode
    return network


def test_poses_carry_the_points_of_a_place_onto_those_of_the_query():
    network = oracle(lcdnet().eval())
    inner = np.stack([MEANS(walls(k, radius=30.0), 0.0) for k in range(6)])
    places = torch.from_numpy(inner)
    angles = rotation_from_rpy(0.03, -0.02, 2.0)
    transform = pose_from(angles, [3.0, -1.0, 0.5])
    query = MEANS.moved(places[:1], torch.from_numpy(transform)[None])[0]
    found = network.relative_poses(query, places)
    assert found.dtype == torch.float64
    assert np.allclose(found[0].numpy(), transform, atol=0.01)
    there = places[0, :1].numpy()[:, :3] * (MEANS.radius / 32767)
    here = query[:1].numpy()[:, :3] * (MEANS.radius / 32767)
    assert np.allclose(moved_points(there, found[0].numpy()), here, atol=0.05)
    assert not np.allclose(moved_points(here, found[0].numpy()), there, atol=1.0)


def test_a_scan_lies_in_itself_as_it_is():
    """Even untrained: equal features are matched most, in pairs that mirror each other."""
    network, images = lcdnet().eval(), scans([0, 1, 2, 3, 4])
    found = network.train().relative_poses(images[1], images)
    assert network.training
    assert found.shape == (5, 4, 4)
    assert torch.allclose(found[1], torch.eye(4, dtype=torch.float64), atol=1e-3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"widths": (4, 4, 4)}, r"lcdnet.widths: \[4, 4, 4\], expected five"),
        ({"momentum": 2.0}, "lcdnet.momentum: 2"),
        ({"iterations": 0}, "lcdnet.iterations: 0"),
        ({"epsilon": 0.03}, "lcdnet.epsilon: 0.03, expected above 0.03"),
        ({"features": 0}, "lcdnet.features: 0"),
        ({"raster": {"kind": "points"}}, "LCDNet: raster: a PointsRaster"),
    ],
)
def test_bad_settings_are_named(values, message):
    settings = {"raster": raster_settings(MEANS), **values}
    with pytest.raises(ConfigError, match=message):
        LcdNet(LcdNetSettings(**settings))


def test_heights_that_leave_a_layer_unseen_are_refused():
    raster = {**raster_settings(MEANS), "size": 4.0}
    with pytest.raises(ConfigError, match=r"raster: 12 voxels along z.* such as 24, 25, 26"):
        LcdNet(LcdNetSettings(raster))
