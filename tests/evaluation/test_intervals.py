"""Wilson's interval: the shares that the observed one is within 1.96 deviations of."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from deepring.evaluation.intervals import Z, wilson


@settings(deadline=None, derandomize=True)
@given(st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_it_is_that_of_the_literature(counts):
    right, n = counts
    expected = binomtest(right, n).proportion_ci(method="wilson")
    assert wilson(right / n, n) == pytest.approx((expected.low, expected.high), abs=1e-9)


@pytest.mark.parametrize(("share", "n"), [(0.3, 20), (0.862, 65), (0.99, 200)])
def test_from_its_ends_the_share_is_1_96_deviations_away(share, n):
    for bound in wilson(share, n):
        assert abs(share - bound) / math.sqrt(bound * (1 - bound) / n) == pytest.approx(Z)


def test_near_one_it_keeps_its_level_and_the_textbook_s_does_not():
    n, truth = 65, 0.97
    right = np.arange(n + 1)
    low, high = np.transpose([wilson(k / n, n) for k in right])
    half = Z * np.sqrt(right / n * (1 - right / n) / n)
    held = binom.pmf(right, n, truth)[(low <= truth) & (truth <= high)].sum()
    textbook = binom.pmf(right, n, truth)[np.abs(right / n - truth) <= half].sum()
    assert held > 0.93
    assert textbook < 0.87


def test_it_stays_within_0_and_1_and_holds_the_share():
    for n in (0, 1, 3, 10_000):
        for share in (0.0, 1.0):
            low, high = wilson(share, n)
            assert 0 <= low <= share <= high <= 1
