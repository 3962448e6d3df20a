"""Two methods on the same queries: only those that one of them answers tell them apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.paired import Paired, exact_mcnemar, paired

CASE = Case("one", "", "sim", "test")


def matches(distances, case=CASE, nearest=1.0):
    distance = np.array(distances, np.float32)[:, None]
    n = len(distance)
    of_all = np.full(n, nearest, np.float32)
    query = np.arange(n) * 3
    return TopMatches(case, query, query[:, None], -distance, None, distance, of_all)


@pytest.mark.parametrize(("b", "c"), [(0, 0), (1, 0), (0, 7), (8, 1), (3, 3), (40, 62)])
def test_the_test_is_binomial_with_a_fair_coin(b, c):
    expected = binomtest(b, b + c, 0.5).pvalue if b + c else 1.0
    assert exact_mcnemar(b, c) == pytest.approx(expected)
    assert exact_mcnemar(c, b) == exact_mcnemar(b, c)


def test_only_the_queries_that_differ_count():
    one = matches([1, 1, 1, 50, 50, 1])
    other = matches([1, 1, 50, 50, 1, 50], replace(CASE, method="other"))
    assert paired(one, other, 10.0) == Paired(queries=6, one_alone=2, other_alone=1)
    assert paired(other, one, 10.0) == Paired(queries=6, one_alone=1, other_alone=2)
    assert paired(one, other, 10.0).p == 1.0
    assert paired(one, one, 10.0).p == 1.0


def test_the_order_of_the_queries_does_not_matter():
    one, other = matches([1, 50, 1, 50]), matches([50, 50, 1, 1])
    turned = TopMatches(
        other.case, other.query[::-1], other.place[::-1], other.score[::-1], None,
        other.distance[::-1], other.nearest[::-1],
    )  # fmt: skip
    assert paired(one, turned, 10.0) == paired(one, other, 10.0) == Paired(4, 1, 1)


def test_other_queries_and_other_places_are_refused():
    one = matches([1, 50, 1])
    strangers = (
        matches([1, 50]),
        matches([1, 50, 1], nearest=2.0),
        matches([1, 50, 1], Case("one", "", "sim", "whole")),
    )
    for other in strangers:
        with pytest.raises(DeepringError, match="not the same ones in the same places"):
            paired(one, other, 10.0)
