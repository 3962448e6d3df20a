"""The circular UNet: exact for multiples of its stride, measured in between, sizes refused."""

import pytest
import torch

from deepring.core.equivariance import assert_equivariant, assert_theta_equivariant, relative_error
from deepring.errors import DeepringError
from deepring.nn.unet import CircularUNet


def make_unet(widths=(4, 6, 8), norm="batch", tau="circular", **changes):
    """In evaluation mode, float64, with batch statistics that are not the initial ones."""
    torch.manual_seed(0)
    unet = CircularUNet(widths, norm=norm, tau_padding=tau, **changes).double()
    with torch.no_grad():
        for _ in range(3):
            unet(torch.randn(4, 1, 16, 16, dtype=torch.float64) + 0.3)
    return unet.eval()


def sinogram(rows=24, bins=16, seed=1):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(2, 1, rows, bins, dtype=torch.float64, generator=generator)


def roll_tau(shift):
    return lambda t: t.roll(shift, dims=-1)


@pytest.mark.parametrize("norm", ["batch", "group", "none"])
@pytest.mark.parametrize("tau", ["circular", "zero"])
@pytest.mark.parametrize("strides", [1, 2, -1, 5])
def test_theta_shifts_by_the_stride_pass_through_exactly(norm, tau, strides):
    unet = make_unet(norm=norm, tau=tau)
    assert unet.stride == 4
    assert_theta_equivariant(unet, sinogram(), strides * unet.stride, tolerance=1e-12)


@pytest.mark.parametrize("strides", [1, 2, -1])
def test_behind_a_stem_shifts_of_its_size_times_the_stride_pass_through_exactly(strides):
    unet = make_unet(widths=(4, 6), stem=2)
    assert unet(sinogram()).shape == (2, 1, 12, 8)
    assert_theta_equivariant(unet, sinogram(), 4 * strides, 2 * strides, tolerance=1e-12)
    # One row further, neighbours land in other channels.
    with pytest.raises(AssertionError):
        assert_theta_equivariant(unet, sinogram(), 4 * strides + 1, 2 * strides, tolerance=1e-3)


def test_a_stem_of_one_changes_nothing():
    plain, stemmed = make_unet(), make_unet(stem=1)
    assert torch.equal(plain(sinogram()), stemmed(sinogram()))


def test_a_stem_divides_rows_and_columns():
    with pytest.raises(DeepringError, match=r"encoder\.stem: 5, expected a divisor of 24 x 16"):
        CircularUNet((2,), stem=5)(torch.zeros(1, 1, 24, 16))


@pytest.mark.parametrize("strides", [1, 3])
def test_tau_shifts_by_the_stride_pass_through_exactly_where_tau_wraps(strides):
    unet, roll = make_unet(), roll_tau(4 * strides)
    assert_equivariant(unet, sinogram(), roll, roll, tolerance=1e-12)


def test_shifts_in_between_are_off_by_a_bounded_error():
    unet, x = make_unet(), sinogram()

    def contrast(image):  # the head's bias aside, which no shift changes
        with torch.no_grad():
            out = unet(image)
        return out - out.mean()

    out = contrast(x)
    errors = {k: relative_error(contrast(x.roll(k, -2)), out.roll(k, -2)) for k in (1, 2, 3, 4)}
    unrelated = relative_error(contrast(sinogram(seed=2)), out)
    print(f"error at a shift of k rows, stride 4: {errors}, unrelated inputs {unrelated:.3f}")
    assert errors.pop(4) < 1e-12
    assert min(errors.values()) > 1e-3
    assert max(errors.values()) < unrelated / 4


def test_one_level_has_no_pooling_and_takes_any_shift():
    unet = make_unet(widths=(4,))
    assert unet.stride == 1
    assert_theta_equivariant(unet, sinogram(rows=7, bins=5), 3, tolerance=1e-12)


def test_zero_padding_of_tau_breaks_tau_but_not_theta():
    unet, roll = make_unet(tau="zero"), roll_tau(4)
    assert_theta_equivariant(unet, sinogram(), 4, tolerance=1e-12)
    with pytest.raises(AssertionError):
        assert_equivariant(unet, sinogram(), roll, roll, tolerance=1e-3)


def test_in_training_mode_equivariance_survives_but_values_depend_on_the_batch():
    unet = make_unet().train()
    x = sinogram()
    assert_theta_equivariant(unet, x, 8, tolerance=1e-12)
    with torch.no_grad():
        assert relative_error(unet(x)[:1], unet(x[:1])) > 1e-3
        unet.eval()
        assert relative_error(unet(x)[:1], unet(x[:1])) < 1e-13


@pytest.mark.parametrize(("rows", "bins"), [(60, 120), (120, 60), (8, 12)])
def test_sizes_that_the_stride_does_not_divide_are_refused(rows, bins):
    unet = CircularUNet((2, 2, 2, 2), convolutions=1)
    assert unet.stride == 8
    with pytest.raises(DeepringError, match=rf"encoder\.widths.*stride of 8.*{rows} x {bins}"):
        unet(torch.zeros(1, 1, rows, bins))


@pytest.mark.parametrize(("rows", "bins"), [(120, 120), (8, 8), (16, 40)])
def test_the_feature_map_has_the_size_of_the_input(rows, bins):
    unet = CircularUNet((2, 2, 2, 2), in_channels=3, out_channels=5, convolutions=1).eval()
    with torch.no_grad():
        assert unet(torch.zeros(1, 3, rows, bins)).shape == (1, 5, rows, bins)


def test_parameters_of_the_small_network():
    unet = CircularUNet((8, 16, 32), convolutions=1)
    # 3x3 convolutions without bias, batch norm's two numbers a channel, the 1x1 head.
    convolutions = 9 * (1 * 8 + 8 * 16 + 16 * 32 + (32 + 16) * 16 + (16 + 8) * 8)
    norms = 2 * (8 + 16 + 32 + 16 + 8)
    count = sum(p.numel() for p in unet.parameters())
    assert count == convolutions + norms + (8 + 1)
    assert count == pytest.approx(14_600, rel=0.01)


def test_every_parameter_takes_part():
    unet = make_unet(norm="group").train()
    unet(sinogram()).square().sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in unet.parameters())


def test_group_norm_takes_widths_that_eight_does_not_divide():
    unet = make_unet(widths=(3, 12, 20), norm="group")
    assert unet(sinogram()).shape == sinogram().shape


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("widths", {"widths": ()}),
        ("widths", {"widths": (4, 0)}),
        ("convolutions", {"convolutions": 0}),
        ("norm", {"norm": "layer"}),
        ("tau_padding", {"tau_padding": "same"}),
        ("stem", {"stem": 0}),
        ("stem", {"stem": 2, "theta_range": "half"}),
    ],
)
def test_bad_arguments_are_named(name, arguments):
    with pytest.raises(DeepringError, match=rf"encoder.*{name}"):
        CircularUNet(**{"widths": (2, 2), **arguments})


@pytest.mark.parametrize("tau", ["circular", "zero"])
def test_without_a_gradient_the_values_are_the_same(tau):
    unet = make_unet(tau=tau)
    with torch.enable_grad():
        expected = unet(sinogram().requires_grad_())
    with torch.no_grad():
        assert torch.equal(unet(sinogram()), expected)
        holes = sinogram()
        holes[0, 0, 3, 5] = torch.nan  # what is not known stays unknown
        assert torch.isnan(unet(holes)[0]).any()
