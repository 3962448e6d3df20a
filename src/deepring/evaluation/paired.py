"""A paired test of two methods on the same queries (McNemar)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import check_radius


@dataclass(frozen=True)
class Paired:
    """How the best places of two methods, one and other, agree on the same queries."""

    queries: int
    """Answerable ones."""
    one_alone: int
    """Queries that one answers rightly, and the other does not."""
    other_alone: int

    @property
    def p(self) -> float:
        """Two-sided p-value of McNemar's exact test, see `exact_mcnemar`."""
        return exact_mcnemar(self.one_alone, self.other_alone)


def exact_mcnemar(one_alone: int, other_alone: int) -> float:
    """Two-sided p-value of McNemar's test, exact by the binomial distribution.

    If both methods were equally good, each query that they answer differently would fall to either
    like a fair coin: p is how probable a split at least as uneven is. 1 where they never differ.

    >>> exact_mcnemar(8, 1), exact_mcnemar(3, 3)
    (0.0390625, 1.0)
    """
    from scipy.stats import binom

    differ = one_alone + other_alone
    return min(1.0, 2 * float(binom.cdf(min(one_alone, other_alone), differ, 0.5)))


def paired(one: TopMatches, other: TopMatches, radius: float) -> Paired:
    """Compare the best places of two methods, right within ``radius`` metres.

    Raises ConfigError for a radius that is not above 0, and DataError unless both were asked the
    same queries in the same places.
    """
    check_radius(radius)
    if not same_queries(one, other):
        raise DataError(
            f"{one.case} and {other.case}: {len(one.query)} and {len(other.query)} queries, not "
            "the same ones in the same places; expected both to be evaluated on the same task; "
            "evaluate them together"
        )
    right = _right(one, radius)[np.argsort(one.query)]
    right_there = _right(other, radius)[np.argsort(other.query)]
    return Paired(
        queries=int((one.nearest <= np.float32(radius)).sum()),
        one_alone=int((right & ~right_there).sum()),
        other_alone=int((right_there & ~right).sum()),
    )


def same_queries(one: TopMatches, other: TopMatches) -> bool:
    """Whether both were asked the same queries in the same places, in any order."""
    order, order_there = np.argsort(one.query), np.argsort(other.query)
    return (
        one.case.place == other.case.place
        and np.array_equal(one.query[order], other.query[order_there])
        and np.array_equal(one.nearest[order], other.nearest[order_there])
    )


def _right(matches: TopMatches, radius: float) -> NDArray[np.bool_]:
    return matches.distance[:, 0] <= np.float32(radius)
