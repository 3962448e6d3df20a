"""Assertions of equivariance and invariance (paper, Eq. 2, 3, 6 and 7), for new layers."""

from collections.abc import Callable

import torch
from jaxtyping import Shaped
from torch import Tensor

Map = Callable[[Tensor], Tensor]


class EquivarianceError(AssertionError):
    """Raised by the assertions; ``error`` is the relative difference of the two sides."""

    def __init__(self, claim: str, error: float, tolerance: float) -> None:
        super().__init__(f"{claim}: relative error {error:.3g}, tolerance {tolerance:.3g}")
        self.error = error


def relative_error(actual: Shaped[Tensor, "*#n"], reference: Shaped[Tensor, "*#n"]) -> float:
    """‖actual - reference‖ / ‖reference‖ over all elements, real or complex.

    >>> relative_error(torch.tensor([3.0, 0.0]), torch.tensor([2.0, 0.0]))
    0.5
    """
    difference = torch.linalg.vector_norm((actual - reference).abs().double())
    return float(difference / torch.linalg.vector_norm(reference.abs().double()).clamp_min(1e-30))


def assert_equivariant(
    function: Map,
    x: Shaped[Tensor, "..."],
    act_in: Map,
    act_out: Map,
    tolerance: float = 1e-5,
    claim: str = "f(g x) = g f(x)",
) -> float:
    """Assert function(act_in(x)) = act_out(function(x)); returns the relative error.

    >>> twice = lambda x: x.roll(2)
    >>> assert_equivariant(torch.relu, torch.tensor([1.0, -2.0, 3.0]), twice, twice)
    0.0
    """
    with torch.no_grad():
        error = relative_error(function(act_in(x)), act_out(function(x)))
    if not error <= tolerance:  # also catches NaN
        raise EquivarianceError(claim, error, tolerance)
    return error


def assert_invariant(
    function: Map,
    x: Shaped[Tensor, "..."],
    act_in: Map,
    tolerance: float = 1e-5,
    claim: str = "f(g x) = f(x)",
) -> float:
    """Assert function(act_in(x)) = function(x); returns the relative error.

    >>> assert_invariant(torch.sum, torch.tensor([1.0, 2.0, 4.0]), lambda x: x.roll(1))
    0.0
    """
    return assert_equivariant(function, x, act_in, lambda y: y, tolerance, claim)


def assert_theta_equivariant(
    function: Map,
    x: Shaped[Tensor, "*batch theta tau"],
    shift: int,
    shift_out: int | None = None,
    tolerance: float = 1e-5,
) -> float:
    """Assert that rolling the rows (axis -2) by ``shift`` rolls the output's by ``shift_out``.

    ``shift_out`` is ``shift`` by default. A network with pooling of total stride s satisfies this
    for multiples of s only.

    >>> ramp = torch.arange(3.0)[:, None]
    >>> assert_theta_equivariant(lambda x: ramp * x, torch.ones(3, 2), shift=1)
    Traceback (most recent call last):
        ...
    deepring.core.equivariance.EquivarianceError: ...
    """
    out = shift if shift_out is None else shift_out
    return assert_equivariant(
        function,
        x,
        lambda t: t.roll(shift, dims=-2),
        lambda t: t.roll(out, dims=-2),
        tolerance,
        f"a shift of {shift} rows of θ gives a shift of {out}",
    )


def assert_tau_invariant(
    function: Map, x: Shaped[Tensor, "*batch theta tau"], shift: int, tolerance: float = 1e-5
) -> float:
    """Assert that rolling the columns (axis -1) by ``shift`` leaves the output unchanged.

    >>> assert_tau_invariant(lambda x: x.mean(-1), torch.tensor([[1.0, 3.0]]), shift=1)
    0.0
    """
    return assert_invariant(
        function,
        x,
        lambda t: t.roll(shift, dims=-1),
        tolerance,
        f"a shift of {shift} bins of τ changes nothing",
    )
