"""FlexConv against its double loop; what a shift and the order of the neighbours change."""

import pytest
import torch

from deepring.errors import ConfigError
from deepring.nn.flex_conv import FlexConv


def weights(conv):
    """B (c, width), Θ (c, 3, width) and β (width,) of a layer, as its definition has them."""
    c = conv.channels
    moments = conv.linear.weight.T  # (4 c, width)
    return moments[:c], moments[c:].view(3, c, -1).transpose(0, 1), conv.linear.bias


def by_loop(conv, features, points, near):
    base, offset, bias = weights(conv)
    out = torch.zeros(*near.shape[:2], len(bias), dtype=features.dtype)
    for b in range(len(near)):
        for i in range(near.shape[1]):
            out[b, i] = bias
            for k in near[b, i].tolist():
                for c in range(conv.channels):
                    theta = (points[b, k] - points[b, i]) @ offset[c]
                    out[b, i] += features[b, k, c] * (base[c] + theta)
    return out


def clouds(n=9, channels=3, seed=0):
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(2, n, 3, generator=generator, dtype=torch.float64) * 5
    features = torch.randn(2, n, channels, generator=generator, dtype=torch.float64)
    near = torch.randint(n, (2, n, 4), generator=generator)
    return features, points, near


@torch.no_grad()
def test_it_is_the_sum_over_neighbours_and_channels():
    torch.manual_seed(0)
    conv = FlexConv(3, 5).double()
    assert torch.allclose(conv(*clouds()), by_loop(conv, *clouds()), atol=1e-9)


@torch.no_grad()
def test_the_cards_two_points():
    conv = FlexConv(1, 1)
    conv.linear.weight.copy_(torch.tensor([[0.1, 0.5, -0.25, 1.0]]))
    conv.linear.bias.zero_()
    points = torch.tensor([[[0.0, 0, 0], [1, 2, 0]]])
    near = torch.tensor([[[0, 1], [0, 1]]])
    out = conv(torch.tensor([[[1.0], [3.0]]]), points, near)
    assert out[0, 0, 0].item() == pytest.approx(0.4)
    # Here Θ·p is 0, so that both signs of the offset agree; the neighbour less the point is meant.
    points[0, 1, 2] = 1.0
    out = conv(torch.tensor([[[1.0], [3.0]]]), points, near)
    assert out[0, :, 0].tolist() == pytest.approx([0.1 + 3 * 1.1, 1 * (0.1 - 1.0) + 3 * 0.1])


@torch.no_grad()
def test_neither_a_shift_nor_the_order_of_neighbours_changes_it():
    torch.manual_seed(0)
    conv = FlexConv(3, 5).double()
    features, points, near = clouds()
    plain = conv(features, points, near)
    shifted = points + torch.tensor([300.0, -50.0, 2.0])
    assert torch.allclose(conv(features, shifted, near), plain, atol=1e-9)
    assert torch.allclose(conv(features, points, near.flip(-1)), plain, atol=1e-12)
    assert not torch.allclose(conv(features, points * 2, near), plain, atol=1e-2)


def test_a_layer_without_channels_is_refused():
    with pytest.raises(ConfigError, match=r"flex_conv\.channels: 0"):
        FlexConv(0, 4)
