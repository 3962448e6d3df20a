"""What is like an array of real numbers is taken; everything else is refused, without a warning."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from deepring.core.arrays import expect_finite, real_array, real_tensor
from deepring.core.correlation import circular_cross_correlation
from deepring.core.radon import radon
from deepring.core.spectrum import row_dft_magnitude
from deepring.errors import DataError, DeepringError

REAL = st.one_of(
    arrays.integer_dtypes(), arrays.unsigned_integer_dtypes(), arrays.floating_dtypes()
)
VALUES = {"elements": {"min_value": 0, "max_value": 100}, "fill": st.nothing()}

OTHERS = (
    None,
    "abc",
    b"abc",
    object(),
    {"a": 1},
    [1, "a"],
    [[1, 2], [3]],
    [None],
    [1j],
    np.array([1 + 2j]),
    np.array(["a"]),
    np.array([object()]),
    np.array([(1, 2.0)], dtype=[("x", "i4"), ("y", "f4")]),
    np.array(["2020-01-01"], dtype="datetime64[s]"),
    torch.zeros(2, dtype=torch.complex64),
    torch.zeros(2, 2).to_sparse(),
    [10**400],
)


@given(arrays.arrays(REAL, arrays.array_shapes(max_dims=3), **VALUES))
@settings(max_examples=100, derandomize=True, deadline=None)
def test_the_same_numbers_are_the_same_tensor_however_they_are_given(array):
    expected = torch.tensor(array.astype(np.float32).tolist())
    frozen = array.copy()
    frozen.setflags(write=False)
    swapped = array.astype(array.dtype.newbyteorder())
    for given_as in (array, frozen, swapped, array.tolist(), array[::-1][::-1], array.astype("O")):
        tensor = real_tensor("values", given_as)
        assert tensor.shape == array.shape
        assert torch.allclose(tensor.float(), expected, rtol=1e-3)


@pytest.mark.parametrize("other", OTHERS, ids=lambda other: type(other).__name__)
def test_everything_else_is_refused_by_name(other):
    for take in (real_array, real_tensor):
        with pytest.raises(DataError, match=r"^values: .*expected"):
            take("values", other)


def test_truth_values_are_no_numbers_unless_they_are_wanted():
    with pytest.raises(DataError, match="an array of bool"):
        real_array("values", [True])
    assert real_tensor("values", [True, False]).dtype is torch.bool


def test_a_tensor_stays_as_it_is():
    for dtype in (torch.float16, torch.bfloat16, torch.float64, torch.uint8, torch.bool):
        tensor = torch.zeros(2, 3, dtype=dtype)
        assert real_tensor("values", tensor) is tensor


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_what_is_not_finite_in_float32_is_refused_and_counted(bad):
    for values in (np.array([1.0, bad]), torch.tensor([1.0, bad], dtype=torch.float64), [1, bad]):
        with pytest.raises(DataError, match="values: 1 of 2 numbers are NaN, infinite or beyond"):
            expect_finite("values", real_tensor("values", values))


@given(arrays.arrays(REAL, st.tuples(*[st.integers(0, 4)] * 3), **VALUES))
@settings(max_examples=60, derandomize=True, deadline=None)
def test_the_equations_take_lists_and_arrays_or_refuse_them(array):
    tensor = torch.from_numpy(np.ascontiguousarray(array.astype(np.float32)))
    for function in (
        lambda values: radon(values, 4),
        row_dft_magnitude,
        lambda values: circular_cross_correlation(values, values).score,
    ):
        try:
            expected = function(tensor)
        except DeepringError as error:
            with pytest.raises(type(error)):
                function(array)
            continue
        assert torch.allclose(function(array), expected, equal_nan=True, rtol=1e-3)


def test_descriptors_of_different_shapes_are_not_correlated():
    with pytest.raises(DataError, match=r"queries \(2, 4, 3\), database \(2, 4, 2\): expected"):
        circular_cross_correlation(torch.zeros(2, 4, 3), torch.zeros(2, 4, 2))
    with pytest.raises(DataError, match="expected"):
        circular_cross_correlation(torch.zeros(4, 3), torch.zeros(4, 3))
