"""DiSCO's UNet against the published layers written out; its two paddings; its size."""

import pytest
import torch
import torch.nn.functional as F

from deepring.core.equivariance import assert_theta_equivariant, relative_error
from deepring.errors import DeepringError
from deepring.methods.disco.disco_unet import DiscoUNet
from deepring.nn.circular import circular_upsample


def make(widths=(4, 6), padding="zero"):
    """float64, in evaluation mode, with batch statistics that are not the initial ones."""
    torch.manual_seed(0)
    net = DiscoUNet(3, widths, padding).double()
    with torch.no_grad():
        for seed in range(3):
            net(occupancy(8, seed + 20))
    return net.eval()


def occupancy(n=2, seed=9, sectors=24, rings=16):
    generator = torch.Generator().manual_seed(seed)
    return (torch.rand(n, 3, sectors, rings, generator=generator) > 0.8).double()


def convolve(x, layer, padding):
    if padding == "zero":
        return F.conv2d(x, layer.weight, padding=1)
    wrapped = F.pad(torch.cat([x[..., -1:, :], x, x[..., :1, :]], dim=-2), (1, 1))
    return F.conv2d(wrapped, layer.conv.weight)


def block(x, layers, padding, last=torch.relu):
    """Convolution, batch norm, activation, twice."""
    first, norm, _, second, other_norm, _ = layers
    x = torch.relu(norm(convolve(x, first, padding)))
    return last(other_norm(convolve(x, second, padding)))


@torch.no_grad()
@pytest.mark.parametrize("padding", ["zero", "circular"])
def test_two_levels_written_out(padding):
    net, x = make(padding=padding), occupancy()
    skip = block(x, net.down[0], padding)
    deep = block(F.max_pool2d(skip, 2), net.down[1], padding)
    if padding == "zero":
        doubled = F.interpolate(deep, size=(24, 16), mode="bilinear", align_corners=True)
    else:
        doubled = circular_upsample(deep, "zero")
    joined = block(torch.cat([doubled, skip], dim=1), net.up[0], padding, torch.sigmoid)
    expected = (joined * net.head.weight[0, :, :1]).sum(dim=1) + net.head.bias
    assert torch.allclose(net(x), expected, atol=1e-12)


def test_one_level_ends_in_a_sigmoid_as_well():
    net, x = make((4,)), occupancy()
    values = block(x, net.down[0], "zero", torch.sigmoid)
    assert torch.allclose(net(x), net.head(values)[:, 0], atol=1e-12)


@pytest.mark.parametrize("strides", [1, 3, -2])
def test_turns_by_the_stride_pass_through_exactly_with_circular_padding(strides):
    net = make((4, 6, 8), "circular")
    assert net.stride == 4
    assert_theta_equivariant(net, occupancy(), 4 * strides, tolerance=1e-12)
    with pytest.raises(AssertionError):
        assert_theta_equivariant(make((4, 6, 8)), occupancy(), 4 * strides, tolerance=1e-4)


@torch.no_grad()
def test_the_paddings_differ_at_the_borders_of_theta_alone():
    zero, circular = make((4,)), make((4,), "circular")
    values = zero.state_dict().values()
    circular.load_state_dict(dict(zip(circular.state_dict(), values, strict=True)))
    a, b = zero(occupancy()), circular(occupancy())
    # Two 3x3 convolutions reach two rows far; along r both take zeros.
    assert torch.allclose(a[:, 2:-2], b[:, 2:-2], atol=1e-12)
    assert relative_error(a[:, [0, 1, -2, -1]], b[:, [0, 1, -2, -1]]) > 1e-3


def test_parameters_of_the_published_network():
    count = sum(p.numel() for p in DiscoUNet().parameters())
    weights = 20 * 64 + 64 * 64 + 64 * 128 + 128 * 128 + 128 * 256 + 256 * 256
    weights += 256 * 512 + 512 * 512 + 768 * 256 + 256 * 256 + 384 * 128 + 128 * 128
    weights += 192 * 64 + 64 * 64
    norms = 2 * 2 * (64 + 128 + 256 + 512 + 256 + 128 + 64)
    assert count == 9 * weights + norms + 64 + 1


def test_bad_arguments_and_sizes_are_named():
    with pytest.raises(DeepringError, match=r"disco\.widths: \[4, 0\]"):
        DiscoUNet(3, (4, 0))
    with pytest.raises(DeepringError, match=r"disco\.padding: 'reflect'"):
        DiscoUNet(3, (4,), "reflect")
    with pytest.raises(DeepringError, match=r"disco\.widths: 3 levels.*24 x 18"):
        DiscoUNet(3, (4, 6, 8))(torch.zeros(1, 3, 24, 18))
