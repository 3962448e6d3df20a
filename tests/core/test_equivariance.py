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


def test_relative_errors_do_not_depend_on_the_unit():
    for unit in (1e-12, 1e-3, 1e6):
        actual, expected = torch.tensor([3.0, 1.0]) * unit, torch.tensor([2.0, 1.0]) * unit
        assert relative_error(actual, expected) == pytest.approx(1 / 5**0.5)
    assert relative_error(torch.zeros(3), torch.zeros(3)) == 0


def test_nothing_at_all_is_a_tolerance():
    assert assert_theta_equivariant(torch.relu, torch.randn(6, 3), 2, tolerance=0.0) == 0


def test_the_imaginary_part_counts():
    assert relative_error(torch.tensor([1 + 1j]), torch.tensor([1 - 1j])) == pytest.approx(2**0.5)


def test_the_error_says_what_was_claimed():
    x, double = torch.ones(3), lambda t: 2 * t
    with pytest.raises(EquivarianceError) as caught:
        assert_equivariant(torch.sin, x, double, double)
    assert str(caught.value).startswith("f(g x) = g f(x): relative error 0.46")
    with pytest.raises(EquivarianceError) as caught:
        assert_invariant(torch.sin, x, double)
    assert str(caught.value).startswith("f(g x) = f(x): relative error 0.08")
    with pytest.raises(EquivarianceError) as caught:
        assert_invariant(torch.sin, x, double, claim="sines do not grow")
    assert str(caught.value).startswith("sines do not grow: ")
    with pytest.raises(EquivarianceError, match="a shift of 1 bins of τ"):
        assert_tau_invariant(lambda t: t, torch.eye(3), 1)


@pytest.mark.parametrize("assertion", [assert_theta_equivariant, assert_tau_invariant])
def test_by_default_float32_may_round_and_nothing_more(assertion):
    def uneven(step):
        """Sums of rows, of which the first row and column count 1 + ``step`` times."""
        factor = torch.ones(4, 4)
        factor[0], factor[:, 0] = 1 + step, 1 + step
        return lambda t: (t * factor).sum(-1, keepdim=True)

    x = torch.eye(4)
    assert 0 < assertion(uneven(2e-6), x, 1) < 1e-5
    with pytest.raises(EquivarianceError):
        assertion(uneven(1e-3), x, 1)


@pytest.mark.parametrize("batch", [(), (2,), (2, 1), (2, 1, 3)])
def test_theta_is_the_last_axis_but_one_and_pooling_divides_its_shift(batch):
    x = torch.randn(*batch, 12, 8)

    def pooled(t):
        return t.unflatten(-2, (6, 2)).amax(-2)

    assert assert_theta_equivariant(pooled, x, 4, 2) == 0
    assert assert_tau_invariant(lambda t: t.amax(-1), x, 3) == 0
    with pytest.raises(EquivarianceError):  # rows of the input are not rows of the output
        assert_theta_equivariant(pooled, x, 4)
    with pytest.raises(EquivarianceError):  # a shift that the stride does not divide
        assert_theta_equivariant(pooled, x, 3, 2)
