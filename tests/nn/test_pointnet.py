"""PointNet's features: T-Nets that start at the identity, points that do not know each other."""

import pytest
import torch

from deepring.errors import DeepringError
from deepring.nn.pointnet import PointFeatures, SharedMlp, TransformNet

SMALL = {
    "first": (8, 6),
    "second": (8, 12),
    "transform_widths": (8, 16),
    "transform_hidden": (10,),
}


def cloud(n=20, seed=0, clouds=3):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(clouds, n, 3, generator=generator, dtype=torch.float64) * 2 - 1


def trained(**changes):
    """float64, with T-Nets off the identity and batch statistics off the initial ones."""
    torch.manual_seed(0)
    net = PointFeatures(**{**SMALL, **changes}).double()
    with torch.no_grad():
        for align in (net.align_points, net.align_features):
            align.last.weight.normal_(0, 0.3)
        for seed in range(3):
            net(cloud(seed=seed + 5, clouds=6))
    return net.eval()


@pytest.mark.parametrize("channels", [3, 64])
def test_transforms_are_square_and_start_at_the_identity(channels):
    torch.manual_seed(0)
    net = TransformNet(channels, (8, 16), (10, 7))
    transforms = net(torch.randn(4, channels, 30))
    assert torch.equal(transforms, torch.eye(channels).expand(4, channels, channels))


def test_only_the_last_layer_learns_at_first_and_all_do_afterwards():
    torch.manual_seed(0)
    net = TransformNet(3, (8, 16), (10,))
    target = torch.randn(4, 3, 3)

    def backward():
        net.zero_grad()
        (net(torch.linspace(-1, 1, 120).view(4, 3, 10)) * target).sum().backward()
        return {name: p.grad.abs().sum().item() > 0 for name, p in net.named_parameters()}

    assert {name for name, learns in backward().items() if learns} == {"last.weight", "last.bias"}
    with torch.no_grad():
        net.last.weight.normal_()
    assert all(backward().values())


def test_transforms_belong_to_their_own_cloud_and_not_to_the_order_of_its_points():
    net = trained().align_points
    x = cloud().transpose(1, 2)
    transforms = net(x)
    assert (transforms[0] - transforms[1]).abs().max() > 1e-3
    for k in range(len(x)):
        assert torch.allclose(net(x[k : k + 1, :, torch.randperm(20)])[0], transforms[k])


def test_points_are_rows_that_the_transform_multiplies():
    net = trained()
    x = cloud()
    aligned = torch.stack([x[k] @ net.align_points(x.transpose(1, 2))[k] for k in range(len(x))])
    features = net.first(aligned.transpose(1, 2))
    lifted = features.transpose(1, 2) @ net.align_features(features)
    expected = net.second(lifted.transpose(1, 2)).transpose(1, 2)
    assert torch.allclose(net(x), expected)


def test_features_follow_their_points():
    net, x = trained(), cloud()
    order = torch.randperm(20, generator=torch.Generator().manual_seed(1))
    features = net(x)
    assert features.shape == (3, 20, 12)
    assert torch.allclose(net(x[:, order]), features[:, order], atol=1e-12)
    assert not torch.allclose(net(x[:, order]), features, atol=1e-3)


def test_a_point_repeated_changes_no_feature():
    net, x = trained(), cloud()
    longer = torch.cat([x, x[:, :4]], dim=1)
    assert torch.allclose(net(longer)[:, :20], net(x), atol=1e-12)


def test_a_shared_network_is_the_same_for_every_point():
    torch.manual_seed(0)
    net = SharedMlp(3, (5, 4)).eval()
    x = torch.randn(2, 3, 6)
    for k in range(6):
        assert torch.allclose(net(x)[..., k], net(x[..., k : k + 1])[..., 0], atol=1e-6)


def test_parameters_of_the_published_size():
    net = PointFeatures()
    # Weights without bias and batch norm's two numbers a channel, in both T-Nets ...
    shared = 64 * 128 + 128 * 1024 + 2 * (64 + 128 + 1024)
    whole = 1024 * 512 + 512 * 256 + 2 * (512 + 256)
    points = 3 * 64 + shared + whole + 257 * 9
    features = 64 * 64 + shared + whole + 257 * 64 * 64
    # ... and in the two MLPs.
    first = 3 * 64 + 64 * 64 + 2 * 128
    second = 64 * 64 + 64 * 128 + 128 * 1024 + 2 * (64 + 128 + 1024)
    count = sum(p.numel() for p in net.parameters())
    assert count == points + features + first + second
    assert count == pytest.approx(2_807_000, rel=0.001)


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("widths", [(), (4, 0)])
def test_bad_widths_are_named(name, widths):
    with pytest.raises(DeepringError, match=rf"pointnet\.{name}"):
        PointFeatures(**{**SMALL, name: widths})


@pytest.mark.parametrize("shape", [(2, 3, 20), (20, 3), (2, 20, 4)])
def test_points_of_another_shape_are_refused(shape):
    with pytest.raises(DeepringError, match=r"points: shape .*expected \(b, n, 3\)"):
        PointFeatures(**SMALL)(torch.zeros(shape))
