"""EgoNN: its size, its heads, what leaves the descriptor unchanged, and that it learns."""

import math

import pytest
import torch

from deepring.errors import DeepringError
from deepring.methods.egonn.egonn_network import (
    WIDTHS,
    EfficientChannelAttention,
    EgoNN,
    GeM,
    TopDown,
    Trunk,
    voxel_grid,
)
from deepring.nn.sparse import SparseTensor
from deepring.rasters.voxels import PADDING, cylindrical_voxels

SMALL = {"widths": (4, 6, 8, 8), "global_levels": (3, 4)}


def cloud(seed, n=400):
    """A few walls around the sensor, (n, 3) float32."""
    generator = torch.Generator().manual_seed(seed)
    azimuth = torch.rand(n, generator=generator) * 2 * math.pi
    bumps = (
        1 + (torch.arange(1, 6)[:, None] * azimuth + torch.randn(5, 1, generator=generator)).sin()
    )
    r = 4 + 4 * bumps[torch.randint(0, 5, (2,), generator=generator)].sum(0)
    z = 4 * torch.rand(n, generator=generator) - 1.5
    return torch.stack([r * azimuth.cos(), r * azimuth.sin(), z], dim=1)


def voxels(seed, n=400):
    return torch.from_numpy(cylindrical_voxels(cloud(seed, n).numpy()))


def make_net(**options):
    """Small, float64, in evaluation mode, with batch statistics that are not the initial ones."""
    torch.manual_seed(0)
    net = EgoNN(**{**SMALL, **options}).double()
    with torch.no_grad():
        for seed in range(3):
            net([voxels(seed), voxels(seed + 10)])
    return net.eval()


def sites_of(features, counts):
    """A sparse tensor of scans with so many sites."""
    sites = torch.tensor([[k, i, 0, 0] for k, n in enumerate(counts) for i in range(n)])
    return SparseTensor.of(features, sites)


def count(module):
    return sum(p.numel() for p in module.parameters())


def test_parameters_of_the_paper_s_network():
    net = EgoNN()
    widths = (32, 64, 64, 128, 128, 128, 128)
    sources = (32, *widths[:-1])
    trunk = 125 * 32 + 2 * 32  # convolution and batch norm
    for a, b in zip(sources, widths, strict=True):
        trunk += 8 * a * a + 2 * a  # down
        trunk += 27 * (a * b + b * b) + 4 * b  # block
        trunk += 3 if b < 128 else 5  # attention's kernel
        trunk += (a * b + 2 * b) * (a != b)  # shortcut
    pyramid = 3 * 128 * 128 + 2 * 8 * 128 * 128
    head = pyramid + (128 * 192 + 192) + (192 * 256 + 256) + 1
    assert [count(net.trunk), count(net.global_head)] == [trunk, head]
    assert count(net) == trunk + head == 4_639_294


@pytest.mark.parametrize(("channels", "kernel"), [(8, 3), (32, 3), (64, 3), (128, 5), (512, 5)])
def test_the_attention_s_kernel_grows_with_the_channels(channels, kernel):
    assert EfficientChannelAttention(channels).conv.kernel_size == (kernel,)


def test_attention_weights_lie_between_0_and_1_and_are_one_scan_s_own():
    attention = EfficientChannelAttention(16)
    features = 3 * torch.randn(12, 16)
    x = sites_of(features, (5, 7))
    weights = attention.weights(x)
    assert weights.shape == (2, 16)
    assert 0 < weights.min() < weights.max() < 1
    assert torch.allclose(attention.weights(sites_of(features[5:], (7,)))[0], weights[1])
    scaled = torch.cat([features[:5] * weights[0], features[5:] * weights[1]])
    assert torch.allclose(attention(x).features, scaled)


def test_the_attention_mixes_neighbouring_channels_without_wrapping():
    attention = EfficientChannelAttention(8)
    left, middle, right = attention.conv.weight[0, 0]
    mean = torch.randn(8)
    expected = middle * mean
    expected[1:] += left * mean[:-1]
    expected[:-1] += right * mean[1:]
    weights = attention.weights(sites_of(mean.expand(4, 8), (4,)))
    assert torch.allclose(weights[0], expected.sigmoid(), atol=1e-6)


def test_gem_is_the_mean_at_1_and_nears_the_maximum():
    features = torch.rand(12, 6, dtype=torch.float64) + 0.1
    x = sites_of(features, (5, 7))
    means = torch.stack([features[:5].mean(0), features[5:].mean(0)])
    highest = torch.stack([features[:5].amax(0), features[5:].amax(0)])
    assert torch.allclose(GeM(p=1.0).double()(x), means, atol=1e-12)
    pooled = [GeM(p=p).double()(x) for p in (1.0, 3.0, 30.0, 300.0)]
    for low, high in zip(pooled, [*pooled[1:], highest], strict=True):
        assert (low < high).all()
    assert torch.allclose(pooled[-1], highest, rtol=0.01)


def test_gem_takes_negative_features_for_zero_and_learns_p():
    pool = GeM()
    pooled = pool(sites_of(-torch.rand(4, 3), (4,)))
    assert torch.allclose(pooled, torch.full((1, 3), 1e-6))
    pool(sites_of(torch.rand(4, 3), (4,))).sum().backward()
    assert pool.p.item() == 3
    assert pool.p.grad.abs() > 0


def test_the_descriptor_has_256_numbers_and_is_not_normalised():
    descriptor = EgoNN().eval()([voxels(0), voxels(1)]).detach()
    assert descriptor.shape == (2, 256)
    assert (descriptor > 0).all()
    assert not torch.allclose(descriptor.norm(dim=1), torch.ones(2), atol=0.1)


def test_the_order_of_the_voxels_does_not_matter():
    net, scan = make_net(), voxels(3)
    shuffled = scan[torch.randperm(len(scan))]
    assert torch.equal(net([shuffled]), net([scan]))


def test_scans_of_a_batch_do_not_see_each_other_in_evaluation_mode():
    net, scans = make_net(), [voxels(k, n) for k, n in ((0, 400), (1, 60), (2, 200))]
    together = net(scans)
    for k, scan in enumerate(scans):
        assert torch.allclose(net([scan])[0], together[k], rtol=1e-9)
    net.train()
    assert not torch.allclose(net([scans[0]])[0], net(scans)[0], rtol=1e-3)


def test_a_padded_batch_is_the_list_of_its_scans():
    net, scans = make_net(), [voxels(k, n) for k, n in ((0, 400), (1, 60))]
    padded = torch.full((2, 500, 3), PADDING, dtype=torch.int16)
    for row, scan in zip(padded, scans, strict=True):
        row[: len(scan)] = scan
    assert torch.equal(net(padded), net(scans))


def test_a_closed_theta_makes_turns_by_the_total_stride_invisible():
    step = 360 / 384
    scan = torch.from_numpy(cylindrical_voxels(cloud(0).numpy(), degrees=step))
    turned = scan.clone()
    turned[:, 0] = (turned[:, 0] + 16 * 5) % 384
    closed = make_net(close_theta=True, steps=(step, 0.3, 0.2))
    assert torch.allclose(closed([turned]), closed([scan]), rtol=1e-9)
    open_circle = make_net(steps=(step, 0.3, 0.2))
    assert not torch.allclose(open_circle([turned]), open_circle([scan]), rtol=1e-4)


def test_every_parameter_takes_part():
    torch.manual_seed(0)
    net = EgoNN(**SMALL).double()
    net([voxels(0), voxels(1)]).sum().backward()
    idle = [name for name, p in net.named_parameters() if p.grad is None or not p.grad.any()]
    assert not idle


def test_a_few_steps_lower_a_triplet_loss():
    torch.manual_seed(0)
    net = EgoNN(**SMALL)
    # Three places, each seen twice: different points on the same walls.
    scans = []
    for seed in range(3):
        points = cloud(seed, 800).numpy()
        scans += [torch.from_numpy(cylindrical_voxels(p)) for p in (points[::2], points[1::2])]
    optimiser = torch.optim.Adam(net.parameters(), lr=3e-3)
    losses = []
    for _ in range(25):
        d = net(scans)
        anchor, positive = d[::2], d[1::2]
        loss = torch.nn.functional.triplet_margin_loss(anchor, positive, anchor.roll(1, 0), 1.0)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[0] > 0.5
    assert losses[-1] < 0.5 * losses[0]


@pytest.mark.parametrize(
    ("message", "scans"),
    [
        (r"scan 1 is \(0, 3\).*at least one", [voxels(0), voxels(0)[:0]]),
        (r"scan 0 is \(0, 3\)", torch.full((2, 9, 3), PADDING, dtype=torch.int16)),
        ("scan 0.*float32", [torch.zeros(4, 3)]),
        (r"scan 0 is \(4, 2\)", [torch.zeros(4, 2, dtype=torch.int16)]),
    ],
)
def test_scans_that_are_no_voxels_are_refused(message, scans):
    with pytest.raises(DeepringError, match=rf"voxels: .*{message}"):
        EgoNN(**SMALL)(scans)


def test_no_scans_give_no_descriptors():
    assert EgoNN(**SMALL)(torch.empty(0, 9, 3, dtype=torch.int16)).shape == (0, 256)
    with pytest.raises(DeepringError, match="voxels: no scan"):
        voxel_grid([])


def test_bad_arguments_are_named():
    with pytest.raises(DeepringError, match=r"egonn\.steps: 1\.0 degrees are 360.*multiple of 128"):
        EgoNN(close_theta=True)
    with pytest.raises(DeepringError, match=r"voxels\.degrees: 0\.7"):
        EgoNN(steps=(0.7, 0.3, 0.2))
    with pytest.raises(DeepringError, match=r"egonn\.widths"):
        Trunk(1, ())
    for levels in ((), (2, 4), (0, 1), (6, 7, 8)):
        with pytest.raises(DeepringError, match=r"egonn\.levels.*consecutive ones of 1 to 7"):
            TopDown(levels, WIDTHS, 8)
