"""RINet: what no turn changes, the published sizes, layers against plain loops, its head."""

import itertools

import pytest
import torch

from deepring.core.equivariance import relative_error
from deepring.errors import ConfigError
from deepring.methods.rinet import RINet, RINetSettings
from deepring.methods.rinet.rinet_network import CircularConv1d, strongest_phase
from deepring.rasters import (
    BevRaster,
    HeightRangesRaster,
    SemanticRangesRaster,
    raster_settings,
)


def network(raster=None, **changes):
    """With statistics of the norms off the initial ones."""
    torch.manual_seed(0)
    raster = SemanticRangesRaster() if raster is None else raster
    net = RINet(RINetSettings(raster_settings(raster), **changes))
    with torch.no_grad():
        for seed in range(3):
            net(images(8, seed + 20, raster.shape))
    return net.eval()


def images(n=4, seed=9, shape=(360, 12)):
    generator = torch.Generator().manual_seed(seed)
    values = torch.rand(n, *shape, generator=generator)
    values = values * torch.rand(n, 1, shape[1], generator=generator)  # scans differ by channel
    return values * (torch.rand(n, *shape, generator=generator) < 0.3)


def test_it_has_the_published_sizes():
    net, plain = RINet(), RINet(RINetSettings(gates=False))
    assert sum(p.numel() for p in net.parameters()) == 98_765
    assert sum(p.numel() for p in plain.parameters()) == 75_125
    assert net.descriptor_shape == (288,)
    lengths = []
    for stage in net.describer.stages:
        stage.register_forward_hook(lambda _, __, out: lengths.append(tuple(out.shape[1:])))
    net.describe(images())
    assert lengths == [(16, 360), (16, 120), (32, 40), (32, 20), (64, 10), (128, 5)]


@pytest.mark.parametrize("gates", [True, False])
def test_no_turn_by_whole_sectors_changes_a_descriptor(gates):
    net, plain = network(gates=gates), images()
    expected = net.describe(plain)
    for turn in (1, 2, 7, 36, 180, 359):
        assert relative_error(net.describe(plain.roll(turn, dims=1)), expected) < 1e-5
    assert relative_error(net.describe(images(seed=10)), expected) > 1e-2
    # A mirrored scan is another.
    assert relative_error(net.describe(plain.flip(1)), expected) > 1e-4


def test_subsampling_takes_the_phase_of_the_largest_norm():
    x = images(3, shape=(5, 24)) - 0.1
    for step in (2, 3, 4):
        found = strongest_phase(x, step)
        for scan in range(3):
            phases = [x[scan, :, p::step] for p in range(step)]
            best = max(range(step), key=lambda p: float(phases[p].double().abs().sum()))
            assert torch.equal(found[scan], phases[best])
    # The usual subsampling, every step-th column from the first, does not bear a roll.
    rolled = strongest_phase(x.roll(1, dims=-1), 2)
    back = [rolled.roll(k, dims=-1) for k in range(12)]
    assert any(torch.equal(one, strongest_phase(x, 2)) for one in back)
    plain = x.roll(1, dims=-1)[..., ::2]
    assert not any(torch.equal(plain.roll(k, dims=-1), x[..., ::2]) for k in range(12))


def test_of_equal_phases_the_first_counts():
    x = torch.tensor([[[1.0, 0, 2, 0, 3, 0], [0, 1, 0, -5, 0, 0]]])
    assert strongest_phase(x, 2).tolist() == [[[1, 2, 3], [0, 0, 0]]]
    x[0, 1, 3] = -6
    assert strongest_phase(x, 2).tolist() == [[[0, 0, 0], [1, -6, 0]]]


def test_a_convolution_goes_on_from_the_end_to_the_start():
    torch.manual_seed(1)
    layer = CircularConv1d(2, 3).eval()
    x = torch.randn(1, 2, 6)
    with torch.no_grad():
        found = layer(x)
        weight, bias = layer.conv.weight, layer.conv.bias
        for out, k in itertools.product(range(3), range(6)):
            total = bias[out] + sum(
                weight[out, c, j] * x[0, c, (k + j) % 6] for c in range(2) for j in range(3)
            )
            total = total / (1 + layer.norm.eps) ** 0.5
            expected = total if total > 0 else 0.1 * total
            assert found[0, out, k].item() == pytest.approx(expected.item(), abs=1e-5)


def test_scores_are_the_heads_logits_of_each_pair_and_symmetric():
    net = network()
    descriptors = net.describe(images(5))
    score, turn = net.compare(descriptors[:3], descriptors)
    assert turn is None
    assert not score.requires_grad
    for i, j in itertools.product(range(3), range(5)):
        logit = net.match_logits(descriptors[i : i + 1], descriptors[j : j + 1])
        assert score[i, j].item() == pytest.approx(logit.item(), abs=1e-5)
    assert torch.allclose(score[:, :3], score[:, :3].T, atol=1e-6)
    assert torch.equal(score.argmax(dim=1), torch.arange(3))


def test_pairs_beyond_one_block_are_compared_alike(monkeypatch):
    net = network()
    descriptors = net.describe(images(7))
    whole = net.compare(descriptors, descriptors).score
    monkeypatch.setattr("deepring.methods.rinet._PAIRS", 15)
    assert torch.allclose(net.compare(descriptors, descriptors).score, whole, atol=1e-6)


def test_every_parameter_takes_part():
    net = network().train()
    first, second = net(images(8)).chunk(2)
    (net.match_logits(first, second).sum() + (first * torch.randn(4, 288)).sum()).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())
    # So does a loss of the scores.
    net.zero_grad()
    net.score(*net(images(8)).chunk(2)).sum().backward()
    assert float(net.describer.stages[0][0].conv.weight.grad.abs().sum()) > 0


def test_bands_of_height_take_the_place_of_classes():
    raster = HeightRangesRaster(sectors=36, bands=5)
    net = network(raster, widths=(4, 6), steps=(3,), hidden=4)
    assert net.describe(images(2, shape=(36, 5))).shape == (2, 10)


def test_an_empty_scan_is_described_too():
    descriptor = network().describe(torch.zeros(1, 360, 12))
    assert torch.isfinite(descriptor).all()


def test_settings_that_mean_nothing_are_refused():
    for values, complaint in (
        ({"raster": raster_settings(BevRaster())}, r"RINet: raster: a BevRaster, expected"),
        ({"widths": (16, 0)}, r"rinet\.widths: \[16, 0\]"),
        ({"steps": (3, 3)}, r"rinet\.steps: \[3, 3\], expected one fewer than rinet\.widths, 5"),
        ({"steps": (7, 2, 2, 2, 2)}, r"rinet\.steps: .* whose product 112 divides the 360"),
        ({"widths": (4, 4), "steps": (360,)}, r"rinet\.steps: \[360\], .* leaves 2 or more"),
        ({"hidden": 0}, r"rinet\.hidden: 0"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            RINet(RINetSettings(**values))
