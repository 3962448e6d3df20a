"""Sinograms over half a turn: a Möbius strip in θ, and a network that keeps to it."""

import math

import pytest
import torch

from deepring.core.equivariance import assert_equivariant, relative_error
from deepring.core.radon import radon
from deepring.core.spectrum import row_dft_magnitude
from deepring.errors import DeepringError
from deepring.methods.deepring import DeepRing
from deepring.nn.circular import CircularConv2d, circular_pad, circular_upsample
from deepring.nn.unet import CircularUNet
from deepring.rasters import BevRaster, PolarRaster, raster_settings
from helpers.networks import deepring_settings


def turned(x, shift):
    """Rows rolled by ``shift``; those that pass the end come back flipped in τ."""
    shift %= 2 * x.shape[-2]
    if shift >= x.shape[-2]:
        return turned(x.flip(-1), shift - x.shape[-2])
    if shift == 0:
        return x
    return torch.cat([x[..., -shift:, :].flip(-1), x[..., :-shift, :]], dim=-2)


def strip(rows=16, bins=12, channels=1, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(2, channels, rows, bins, dtype=torch.float64, generator=generator)


def test_a_quarter_turn_of_the_image_shifts_and_flips():
    image = torch.rand(1, 20, 20)
    # 12 rows over 180 degrees: a quarter turn is 6 rows. Axes are [x, y], and rot90 turns the
    # first towards the second: counter-clockwise.
    half = radon(image, 12, 20, theta_range="half")
    rotated = radon(torch.rot90(image, 1, (1, 2)), 12, 20, theta_range="half")
    assert relative_error(rotated, turned(half, 6)) < 1e-5
    assert relative_error(rotated, half.roll(6, -2)) > 0.05  # the usual misreading: a plain roll
    assert relative_error(rotated, turned(half, -6)) > 0.05  # and the other way round


@pytest.mark.parametrize("shift", [1, 5, -3, 16, 21])
@pytest.mark.parametrize("tau", ["circular", "zero"])
def test_the_convolution_commutes_with_any_turn(shift, tau):
    torch.manual_seed(1)
    layer = CircularConv2d(2, 3, 3, tau, "half").double()
    x = strip(channels=2)
    assert_equivariant(layer, x, lambda t: turned(t, shift), lambda t: turned(t, shift), 1e-12)


def test_kernels_that_are_not_symmetric_in_tau_would_not():
    torch.manual_seed(1)
    layer = CircularConv2d(1, 1, 3, "circular", "half").double()
    plain = torch.nn.functional.conv2d
    x = strip()

    def unsymmetric(t):
        return plain(circular_pad(t, 1, "circular", "half"), layer.conv.weight.detach())

    error = relative_error(unsymmetric(turned(x, 3)), turned(unsymmetric(x), 3))
    assert error > 0.05


@pytest.mark.parametrize("tau", ["circular", "zero"])
def test_upsampling_commutes_with_twice_the_turn(tau):
    x = strip()
    assert_equivariant(
        lambda t: circular_upsample(t, tau, "half"),
        x,
        lambda t: turned(t, 3),
        lambda t: turned(t, 6),
        1e-12,
    )


@pytest.mark.parametrize("strides", [1, 3, 4, 5])
def test_the_unet_commutes_with_turns_by_its_stride(strides):
    torch.manual_seed(2)
    unet = CircularUNet((4, 6, 8), theta_range="half").double().eval()
    shift = strides * unet.stride
    assert_equivariant(unet, strip(), lambda t: turned(t, shift), lambda t: turned(t, shift), 1e-12)


@torch.no_grad()
def test_a_unet_over_a_full_turn_would_not():
    torch.manual_seed(2)
    unet, x = CircularUNet((4, 6, 8), theta_range="full").double().eval(), strip()
    assert relative_error(unet(turned(x, 4)), turned(unet(x), 4)) > 1e-3


def test_the_row_spectrum_forgets_the_flip():
    x = strip()
    assert torch.allclose(row_dft_magnitude(turned(x, 5)), row_dft_magnitude(x).roll(5, -2))


def half_turn_network():
    torch.manual_seed(3)
    raster = raster_settings(BevRaster(cells=64))
    return DeepRing(
        deepring_settings(
            raster=raster, angles=64, bins=64, theta_range="half", widths=(4, 6), convolutions=1
        )
    ).eval()


def test_a_network_over_half_a_turn_finds_the_yaw_up_to_180_degrees():
    network = half_turn_network()
    generator = torch.Generator().manual_seed(4)
    image = torch.rand(1, 64, 64, generator=generator) > 0.9
    quarter = torch.rot90(image, 1, (1, 2))  # [x, y] axes: from +x to +y, counter-clockwise
    a, b = network.describe(image), network.describe(quarter)
    found = network.compare(b, a)
    assert found.score.item() == pytest.approx(1, abs=1e-4)
    assert abs(abs(found.turn.item()) - math.pi / 2) < 1e-5
    upside_down = network.describe(torch.rot90(image, 2, (1, 2)))
    assert abs(network.compare(upside_down, a).turn.item()) < 1e-5  # 180 degrees looks like none


def test_half_turn_yaw_has_the_sign_of_the_turn():
    network = half_turn_network()
    x = strip(rows=64, bins=64).float()

    def describe(sinogram):
        with torch.no_grad():
            return network.normalise(network.aggregate(network.encoder(sinogram)))

    for rows in (10, -10):
        turn = network.compare(describe(turned(x, rows)), describe(x)).turn.diagonal()
        assert torch.allclose(turn, torch.full((2,), rows * math.pi / 64), atol=1e-5)


def test_only_a_sinogram_has_half_a_turn():
    polar = raster_settings(PolarRaster(24, 16))
    with pytest.raises(DeepringError, match=r"representation\.theta_range"):
        DeepRing(deepring_settings(raster=polar, angles=None, bins=None, theta_range="half"))
    with pytest.raises(DeepringError, match="'quarter'"):
        DeepRing(deepring_settings(theta_range="quarter"))
