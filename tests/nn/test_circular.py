"""Circular convolution and upsampling against explicit modular indices; exact equivariance."""

import itertools

import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.equivariance import assert_equivariant, assert_theta_equivariant, relative_error
from deepring.errors import DeepringError
from deepring.nn.circular import CircularConv2d, circular_pad, circular_upsample


def image(*shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, dtype=torch.float64, generator=generator)


def make_conv(inputs, outputs, kernel=3, tau="circular", seed=0):
    torch.manual_seed(seed)
    return CircularConv2d(inputs, outputs, kernel, tau).double()


def roll_tau(shift):
    return lambda t: t.roll(shift, dims=-1)


def modular_convolution(x, kernel, sign):
    """Σ_mn R[(i + sign m) % M, (j + sign n) % N] K[m, n], offsets from the kernel's centre."""
    rows, columns = x.shape
    reach = kernel.shape[0] // 2
    out = torch.zeros_like(x)
    offsets = range(-reach, reach + 1)
    for i, j, m, n in itertools.product(range(rows), range(columns), offsets, offsets):
        value = x[(i + sign * m) % rows, (j + sign * n) % columns]
        out[i, j] += value * kernel[m + reach, n + reach]
    return out


@pytest.mark.parametrize("kernel", [1, 3, 5])
def test_the_convolution_by_modular_indices(kernel):
    layer, x = make_conv(1, 1, kernel), image(1, 1, 7, 6)
    weight = layer.conv.weight[0, 0].detach()
    # torch correlates: its kernel is the paper's turned by half a turn, learned all the same.
    paper = modular_convolution(x[0, 0], weight.flip(0, 1), sign=-1)
    correlation = modular_convolution(x[0, 0], weight, sign=+1)
    out = (layer(x)[0, 0] - layer.conv.bias).detach()
    assert torch.allclose(out, correlation, atol=1e-12)
    assert torch.allclose(out, paper, atol=1e-12)
    if kernel > 1:  # the paper's sign with torch's kernel is another map
        misread = modular_convolution(x[0, 0], weight, sign=-1)
        assert relative_error(out, misread) > 0.1


def test_channels_add_up():
    layer, x = make_conv(3, 2), image(2, 3, 5, 6)
    expected = torch.zeros(2, 2, 5, 6, dtype=torch.float64)
    for b, o, c in itertools.product(range(2), range(2), range(3)):
        expected[b, o] += modular_convolution(x[b, c], layer.conv.weight[o, c].detach(), sign=+1)
    expected += layer.conv.bias.detach()[:, None, None]
    assert torch.allclose(layer(x).detach(), expected, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(3, 9),
    st.integers(3, 9),
    st.sampled_from([1, 3, 5]),
    st.integers(-20, 20),
    st.sampled_from(["circular", "zero"]),
)
def test_theta_shifts_of_any_size_pass_through_exactly(rows, columns, kernel, shift, tau):
    layer = make_conv(2, 3, kernel, tau)
    assert_theta_equivariant(layer, image(2, 2, rows, columns), shift, tolerance=1e-13)


@settings(max_examples=20, deadline=None)
@given(st.integers(3, 9), st.integers(3, 9), st.integers(-20, 20))
def test_tau_shifts_pass_through_exactly_where_tau_wraps(rows, columns, shift):
    x = image(1, 2, rows, columns)
    roll = roll_tau(shift)
    assert_equivariant(make_conv(2, 3), x, roll, roll, tolerance=1e-13)


def test_zero_padding_of_tau_breaks_tau_but_not_theta():
    layer, x, roll = make_conv(1, 2, tau="zero"), image(1, 1, 8, 8), roll_tau(3)
    assert_theta_equivariant(layer, x, 5, tolerance=1e-13)
    with pytest.raises(AssertionError):
        assert_equivariant(layer, x, roll, roll, tolerance=0.05)


def test_torchs_own_zero_padding_breaks_theta():
    torch.manual_seed(0)
    plain = torch.nn.Conv2d(1, 2, 3, padding=1).double()
    with pytest.raises(AssertionError):
        assert_theta_equivariant(plain, image(1, 1, 8, 8), 3, tolerance=0.05)


@pytest.mark.parametrize("tau", ["circular", "zero"])
def test_padding_wraps_theta_and_treats_tau_as_told(tau):
    x = image(1, 1, 4, 5)
    padded = circular_pad(x, 2, tau)
    assert padded.shape == (1, 1, 8, 9)
    for i, j in itertools.product(range(-2, 6), range(-2, 7)):
        inside = tau == "circular" or 0 <= j < 5
        expected = x[0, 0, i % 4, j % 5] if inside else 0.0
        assert padded[0, 0, i + 2, j + 2] == expected


def doubled_by_loop(x, tau):
    """Bilinear, output sample k at (k + 1/2) / 2 - 1/2 of the input: weights 3/4 and 1/4."""
    rows, columns = x.shape
    out = torch.zeros(2 * rows, 2 * columns, dtype=x.dtype)
    for i, j in itertools.product(range(2 * rows), range(2 * columns)):
        down, side = (1 if i % 2 else -1), (1 if j % 2 else -1)
        for p, share_p in ((i // 2, 0.75), (i // 2 + down, 0.25)):
            for q, share_q in ((j // 2, 0.75), (j // 2 + side, 0.25)):
                column = q % columns if tau == "circular" else min(max(q, 0), columns - 1)
                out[i, j] += share_p * share_q * x[p % rows, column]
    return out


@pytest.mark.parametrize("tau", ["circular", "zero"])
@pytest.mark.parametrize("shape", [(4, 6), (1, 3), (5, 1)])
def test_upsampling_against_a_loop(shape, tau):
    x = image(1, 1, *shape)
    out = circular_upsample(x, tau)
    assert out.shape == (1, 1, 2 * shape[0], 2 * shape[1])
    assert torch.allclose(out[0, 0], doubled_by_loop(x[0, 0], tau), atol=1e-14)


def doubled_by_torch(x):
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


@pytest.mark.parametrize("shift", [1, 3, -2])
def test_upsampling_doubles_the_shift_exactly_where_torchs_own_does_not(shift):
    x = image(1, 2, 6, 5)
    assert_theta_equivariant(circular_upsample, x, shift, 2 * shift, tolerance=1e-14)
    assert_equivariant(circular_upsample, x, roll_tau(shift), roll_tau(2 * shift), tolerance=1e-14)
    with pytest.raises(AssertionError):
        assert_theta_equivariant(doubled_by_torch, x, shift, 2 * shift, tolerance=0.02)
    inner = (..., slice(1, -1), slice(1, -1))
    assert torch.allclose(circular_upsample(x)[inner], doubled_by_torch(x)[inner])


def test_upsampling_with_zero_padding_keeps_theta_and_not_tau():
    x = image(1, 1, 6, 6)
    assert_theta_equivariant(lambda t: circular_upsample(t, "zero"), x, 1, 2, tolerance=1e-14)
    with pytest.raises(AssertionError):
        assert_equivariant(
            lambda t: circular_upsample(t, "zero"), x, roll_tau(1), roll_tau(2), tolerance=0.02
        )


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("kernel", {"kernel": 2}), ("kernel", {"kernel": -1}), ("tau_padding", {"tau": "reflect"})],
)
def test_bad_arguments_are_named(name, arguments):
    with pytest.raises(DeepringError, match=rf"encoder\.{name}"):
        CircularConv2d(1, 1, **arguments)


@pytest.mark.parametrize("theta_range", ["full", "half"])
@pytest.mark.parametrize("tau", ["circular", "zero"])
@pytest.mark.parametrize("pad", [1, 2])
def test_gradients_are_those_of_the_numbers_themselves(pad, tau, theta_range):
    x = image(2, 1, 3, 4).requires_grad_()
    assert torch.autograd.gradcheck(lambda t: circular_pad(t, pad, tau, theta_range), x)
    assert torch.autograd.gradcheck(lambda t: circular_upsample(t, tau, theta_range), x)


def test_padding_is_the_same_for_channels_last_and_in_inference():
    x = image(2, 3, 4, 6)
    expected = circular_pad(x, 1)
    assert torch.equal(circular_pad(x.to(memory_format=torch.channels_last), 1), expected)
    with torch.inference_mode():
        assert torch.equal(circular_pad(x, 1), expected)


def test_upsampling_trains_at_a_size_that_was_first_seen_in_inference():
    with torch.inference_mode():
        circular_upsample(image(1, 1, 11, 17))
    x = image(1, 1, 11, 17).requires_grad_()
    circular_upsample(x).sum().backward()
    assert x.grad.sum() == pytest.approx(4 * x.numel())
