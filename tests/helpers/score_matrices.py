"""Made-up scores and distances of queries and places, and the best places of each query."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches

CASE = Case("toy", "", "sim", "test")
RADII = (10.0, 0.5, 5.0, 10.4, 39.0, 41.0)


def matrices(places=12):
    """Scores and distances of up to so many places."""
    return st.tuples(st.integers(1, 9), st.integers(1, places)).flatmap(
        lambda shape: st.tuples(
            # few values, so that equal scores and distances at exactly a radius are frequent
            hnp.arrays(np.float32, shape, elements=st.sampled_from([-np.inf, -1, 0, 0.5, 2])),
            hnp.arrays(np.float32, shape, elements=st.sampled_from([0, 5, 10, 10.5, 40])),
        )
    )


def best_of(scores, distances, k=5):
    """The ``k`` best places; equal scores rank by place."""
    best = np.argsort(-scores, axis=1, kind="stable")[:, :k]
    score, distance = (np.take_along_axis(table, best, 1) for table in (scores, distances))
    nearest = distances.min(axis=1)
    return TopMatches(CASE, np.arange(len(best)), best, score, None, distance, nearest)
