"""The assertions that ship: they pass what is equivariant, and fail what is not."""

import pytest
import torch

from deepring.core.equivariance import (
    EquivarianceError,
    assert_equivariant,
    assert_invariant,
    assert_tau_invariant,
    assert_theta_equivariant,
    relative_error,
)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-6), (torch.float64, 1e-14)])
def test_a_pointwise_map_is_equivariant_to_the_digit(dtype, tolerance):
    x = torch.randn(2, 1, 12, 8, dtype=dtype)
    assert assert_theta_equivariant(torch.relu, x, 5, tolerance=tolerance) == 0.0
    assert assert_tau_invariant(lambda t: t.sum(-1), x, 3, tolerance=tolerance) <= tolerance


def test_a_position_dependent_map_fails_with_its_error():
    x = torch.ones(1, 1, 4, 4)
    ramp = torch.arange(4.0)[:, None]
    with pytest.raises(EquivarianceError, match="2 rows") as caught:
        assert_theta_equivariant(lambda t: t * ramp, x, 2)
    assert caught.value.error > 0.5
    with pytest.raises(EquivarianceError):
        assert_tau_invariant(lambda t: t, torch.randn(1, 1, 4, 4), 1)


def test_the_wrong_action_on_the_output_fails():
    x = torch.randn(6, 3)
    flip = lambda t: t.flip(0)  # noqa: E731
    assert_equivariant(torch.relu, x, flip, flip)
    with pytest.raises(EquivarianceError):
        assert_equivariant(torch.relu, x, flip, lambda t: t)


def test_nan_never_passes():
    with pytest.raises(EquivarianceError):
        assert_invariant(lambda t: t * float("nan"), torch.ones(3), lambda t: t)


def test_relative_error_is_relative_to_the_expected_side():
    assert relative_error(torch.tensor([3.0]), torch.tensor([2.0])) == pytest.approx(0.5)


def test_the_imaginary_part_counts():
    assert relative_error(torch.tensor([1 + 1j]), torch.tensor([1 - 1j])) == pytest.approx(2**0.5)
