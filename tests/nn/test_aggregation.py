"""Aggregation over τ: shapes, invariances, and what each does not undo."""

import pytest
import torch

from deepring.core.equivariance import (
    EquivarianceError,
    assert_equivariant,
    assert_invariant,
    assert_tau_invariant,
)
from deepring.core.spectrum import column_dft_magnitude
from deepring.nn.aggregation import AGGREGATIONS, channels_for, dft, gap, gmp

ROWS, BINS = 12, 16


def feature(channels=1, batch=2, bins=BINS):
    return torch.randn(batch, channels, ROWS, bins, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize(("kind", "values"), [("dft", 9), ("gap", 1), ("gmp", 1), ("multi_gap", 9)])
def test_shapes_of_what_the_network_gives(kind, values):
    x = feature(channels_for(kind, BINS))
    assert AGGREGATIONS[kind](x).shape == (2, ROWS, values)


@pytest.mark.parametrize("bins", [15, 16, 60, 120])
def test_multi_gap_keeps_the_size_of_the_descriptor(bins):
    by_dft = AGGREGATIONS["dft"](feature(channels_for("dft", bins), bins=bins))
    by_gap = AGGREGATIONS["multi_gap"](feature(channels_for("multi_gap", bins), bins=bins))
    assert by_gap.shape == by_dft.shape


@pytest.mark.parametrize("kind", AGGREGATIONS)
@pytest.mark.parametrize("channels", [1, 3])
def test_shifts_of_tau_leave_no_trace(kind, channels):
    assert_tau_invariant(AGGREGATIONS[kind], feature(channels), 5)


@pytest.mark.parametrize("kind", AGGREGATIONS)
def test_shifts_that_differ_from_row_to_row_leave_no_trace(kind):
    shifts = torch.arange(ROWS) * 5 % 7

    def translate(x):
        rows = [x[..., k, :].roll(int(s), -1) for k, s in enumerate(shifts)]
        return torch.stack(rows, dim=-2)

    assert_invariant(AGGREGATIONS[kind], feature(), translate)


@pytest.mark.parametrize("kind", ["dft", "gap", "gmp", "multi_gap"])
def test_shifts_of_theta_roll_the_rows(kind):
    # The descriptor is (b, θ, m): rows lie on its second axis, not on its last but one channel.
    assert_equivariant(
        AGGREGATIONS[kind], feature(3), lambda x: x.roll(5, dims=2), lambda d: d.roll(5, dims=1)
    )
    with pytest.raises(EquivarianceError):
        assert_invariant(AGGREGATIONS[kind], feature(3), lambda x: x.roll(5, dims=2), 0.1)


def test_a_second_dft_undoes_the_rotation_too():
    assert_invariant(
        lambda x: column_dft_magnitude(dft(x)), feature(3), lambda x: x.roll(5, dims=2)
    )


def test_dft_keeps_apart_what_the_means_confuse():
    one, other = feature(), feature().flip(-1) * torch.tensor([1.0])
    other[..., 0], other[..., 5] = other[..., 5].clone(), other[..., 0].clone()
    assert torch.allclose(gap(one), gap(other), atol=1e-6)
    assert torch.allclose(gmp(one), gmp(other))
    assert not torch.allclose(dft(one), dft(other), atol=1e-2)


def test_values_by_hand():
    x = torch.tensor([[[[1.0, 2.0, 6.0], [0.0, -3.0, 3.0]], [[1.0, 1.0, 1.0], [2.0, 0.0, 1.0]]]])
    assert torch.allclose(gap(x), torch.tensor([[[3.0, 1.0], [0.0, 1.0]]]))
    assert torch.allclose(gmp(x), torch.tensor([[[6.0, 1.0], [3.0, 2.0]]]))
    # The zero frequency of the orthonormal DFT is the sum over the root of the length.
    assert torch.allclose(dft(x)[0, :, 0], torch.tensor([9.0, 0.0]) / 3**0.5)
    assert torch.allclose(dft(x)[0, :, 2], torch.tensor([3.0, 3.0]) / 3**0.5)
