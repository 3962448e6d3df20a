"""Intervals of shares: how far a recall may lie from what more queries would give."""

import math

#: Standard deviations on either side of the middle, for 95 %.
Z = 1.959963984540054


def wilson(share: float, count: float) -> tuple[float, float]:
    """The 95 % interval of a share of ``count`` independent trials, as (low, high) in [0, 1].

    Wilson's score interval (1927): all true shares that the observed one is within 1.96 standard
    deviations of. It keeps its level for few trials and near 0 and 1, where the textbook's
    p ± 1.96 √(p(1-p)/n) does not. Consecutive queries of a drive are alike, so that a recall's
    true uncertainty is rather larger.

    >>> [round(bound, 3) for bound in wilson(0.5, 10)]
    [0.237, 0.763]
    >>> [round(bound, 3) for bound in wilson(1.0, 10)]
    [0.722, 1.0]
    >>> wilson(0.0, 0)
    (0.0, 1.0)
    """
    if not count:
        return 0.0, 1.0
    weight = Z**2 / count
    middle = (share + weight / 2) / (1 + weight)
    half = Z * math.sqrt(share * (1 - share) / count + weight / (4 * count)) / (1 + weight)
    # Rounding may not leave the range, nor the share its interval.
    return max(0.0, min(middle - half, share)), min(1.0, max(middle + half, share))
