"""Retrieval metrics of the evaluation protocol: Recall@K, precision-recall, max-F1, AUC and AP.

A retrieval is right when the retrieved place lies within the radius; a query is answerable when
some database place does. A query counts by its top score and the rank of its first right
place: `first_right` reduces whole score matrices to them, `first_right_among` the best k
places at several radii. `recall_of_ranks` and `curve_of_ranks` count from there.
"""

import math
from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor

from deepring import checks
from deepring.errors import DataError

Over = Literal["answerable", "all"]  # the queries that Recall@K is a share of

#: The rank of a first right place that is not among the best k.
BEHIND = torch.iinfo(torch.int64).max


def first_right(scores: Tensor, distances: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Reduce each query to its top score and the rank of its first right place.

    Args:
        scores: (q, d) floating, of any scale and sign; higher is better, equals rank by index.
        distances: (q, d) metres from each query to each database place.
        radius: revisit radius in metres; a place at exactly this distance is right.

    Returns:
        Top score (q,) float32, and rank (q,) int64, counted from 1; 0 where unanswerable.

    Raises:
        ConfigError: a radius that is not above 0.
        DataError: shapes that differ, an empty database, NaN, or a negative distance.

    >>> first_right(torch.tensor([[0.9, 0.5]]), torch.tensor([[40.0, 3.0]]), radius=10.0)
    (tensor([0.9000]), tensor([2]))
    """
    check_radius(radius)
    _check_pair(scores, distances)
    right = distances <= radius
    best_right = scores.masked_fill(~right, -math.inf).amax(dim=1, keepdim=True)
    # argmax over booleans as integers: the first of equals, also where the score is -inf
    index = (right & (scores == best_right)).int().argmax(dim=1, keepdim=True)
    earlier = torch.arange(scores.shape[1], device=scores.device) < index
    ahead = (scores > best_right) | ((scores == best_right) & earlier)
    rank = torch.where(right.any(dim=1), ahead.sum(dim=1) + 1, 0)
    return scores.amax(dim=1).float(), rank


def first_right_among(distances: Tensor, nearest: Tensor, radii: Sequence[float]) -> Tensor:
    """Ranks (r, q) int64 of the first right place among each query's best k, for r radii at once.

    Counted from 1; `BEHIND` where all right places lie behind the best k, so that no Recall@K
    counts them; 0 where the query is unanswerable.

    Args:
        distances: (q, k) metres from each query to its best places, best first.
        nearest: (q,) metres from each query to the nearest place of the whole database.
        radii: r revisit radii in metres; a place at exactly this distance is right.

    Raises:
        ConfigError: a radius that is not above 0.
        DataError: shapes that differ.

    >>> first_right_among(torch.tensor([[40.0, 3.0]]), torch.tensor([3.0]), (2.0, 10.0, 50.0)).T
    tensor([[0, 2, 1]])
    """
    if distances.ndim != 2 or nearest.shape != distances.shape[:1]:
        raise DataError(
            f"distances {tuple(distances.shape)} and nearest {tuple(nearest.shape)}: expected "
            "(queries, k) and (queries,); pass both for the same queries"
        )
    within = torch.tensor([check_radius(radius) for radius in radii], dtype=torch.float32)
    right = distances <= within[:, None, None]
    behind = torch.where(nearest <= within[:, None], BEHIND, 0)
    return torch.where(right.any(dim=2), right.int().argmax(dim=2) + 1, behind)


def recall_at_k(
    scores: Tensor, distances: Tensor, k: int, radius: float, over: Over = "answerable"
) -> Tensor:
    """Share of queries with a right place among their ``k`` best scores (protocol: Recall@K).

    Args:
        scores, distances, radius: as ``first_right``.
        k: how many places count, at least 1; more than d means all of them.
        over: the share of the answerable queries, or of all of them.

    Returns:
        0-dimensional float32 in [0, 1].

    Raises:
        ConfigError: a radius that is not above 0, another ``k`` or ``over``.
        DataError: as ``first_right``; no answerable query.

    >>> scores, distances = torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]])
    >>> recall_at_k(scores, distances, k=1, radius=10.0)
    tensor(1.)
    >>> recall_at_k(scores, distances, k=1, radius=10.0, over="all")
    tensor(0.5000)
    """
    return recall_of_ranks(first_right(scores, distances, radius)[1], k, radius, over)


def place_precision_recall(
    scores: Tensor, distances: Tensor, radius: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Precision and recall at every distinct top score, the highest threshold first.

    One decision per query: its top place is accepted when its score reaches the threshold. Accepted
    and right is a true positive; accepted and wrong a false positive, answerable or not; rejected
    although a right place exists a false negative; rejected otherwise a true negative (protocol).
    Recall is 0 while nothing right is accepted, never falls, and ends at 1 unless every retrieval
    is wrong: an answerable query accepted with a wrong place costs precision, not recall.

    Arguments but ``k`` and ``over``, and errors: ``recall_at_k``.

    Returns:
        precision, recall, thresholds: (t,) float32 each, t distinct top scores.

    >>> scores, distances = torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]])
    >>> place_precision_recall(scores, distances, radius=10.0)
    (tensor([0.0000, 0.5000]), tensor([0., 1.]), tensor([0.9000, 0.1000]))
    """
    return curve_of_ranks(*first_right(scores, distances, radius), radius)


def max_f1(scores: Tensor, distances: Tensor, radius: float) -> Tensor:
    """Highest F1 = 2PR / (P + R) over all thresholds of ``place_precision_recall``.

    Where every query is answerable, accepting everything gives 2R / (1 + R) for R = Recall@1, so
    that no result can lie below it. Arguments but ``k`` and ``over``, and errors: ``recall_at_k``.

    >>> max_f1(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]), radius=10.0)
    tensor(0.6667)
    """
    return f1_along(*place_precision_recall(scores, distances, radius)[:2]).amax()


def place_auc(scores: Tensor, distances: Tensor, radius: float) -> Tensor:
    """Area under the curve of ``place_precision_recall``; see ``area_under`` for the rule.

    Report it beside Recall@1: straight lines between few thresholds can enclose half the square
    though few queries are right. Arguments but ``k`` and ``over``, and errors: ``recall_at_k``.

    >>> place_auc(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]), radius=10.0)
    tensor(0.2500)
    """
    return area_under(*place_precision_recall(scores, distances, radius)[:2])


def f1_along(precision: Tensor, recall: Tensor) -> Tensor:
    """F1 (t,) at each point of a curve (t,), (t,); 0 where precision and recall are both 0."""
    return 2 * precision * recall / (precision + recall).clamp(min=1e-12)


def area_under(precision: Tensor, recall: Tensor) -> Tensor:
    """Trapezoid over recall (t,), not falling; begun at recall 0 with the first precision."""
    anchor = torch.zeros_like(recall[:1])
    return torch.trapezoid(torch.cat([precision[:1], precision]), torch.cat([anchor, recall]))


def average_precision(precision: Tensor, recall: Tensor) -> Tensor:
    """Average precision: Σ (R_i - R_(i-1)) P_i along a curve (t,), the highest threshold first.

    R_0 is 0. No straight lines are drawn between thresholds, so that few of them, or many equal
    scores, flatter nobody as they may in ``area_under``.

    >>> average_precision(torch.tensor([1.0, 0.5, 0.6]), torch.tensor([0.5, 0.5, 1.0]))
    tensor(0.8000)
    """
    return (recall.diff(prepend=torch.zeros_like(recall[:1])) * precision).sum()


def one_percent(places: int) -> int:
    """How many places are 1 % of them, rounded half to even and at least 1, as PointNetVLAD counts.

    >>> one_percent(120), one_percent(160), one_percent(4541), one_percent(3)
    (1, 2, 45, 1)
    """
    return max(1, round(places / 100))


def recall_of_ranks(
    ranks: Tensor, k: int | Tensor, radius: float, over: Over = "answerable"
) -> Tensor:
    """``recall_at_k`` of the ranks (q,) that `first_right` or `first_right_among` gave.

    ``k`` is a number of places, or one (q,) for each query.
    """
    check_share(1 if isinstance(k, Tensor) else k, over)
    answerable = _count_answerable(ranks, radius)
    right = ((ranks > 0) & (ranks <= k)).sum()
    return right.float() / (answerable if over == "answerable" else len(ranks))


def curve_of_ranks(
    top: Tensor, ranks: Tensor, radius: float, wrong: Tensor | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """``place_precision_recall`` of the top scores (q,) and the ranks (q,) of `first_right`.

    ``wrong`` (q,) bool says whose best place is wrong; None means all that are not right. A best
    place that is neither lies in the grey zone: accepted, it counts for nothing, and the curve
    begins where one counts.
    """
    answerable = _count_answerable(ranks, radius)
    top, order = top.sort(descending=True)
    last_of_equals = torch.cat([top[1:] != top[:-1], top.new_ones(1, dtype=torch.bool)])
    accepted = last_of_equals.nonzero().flatten() + 1
    right = ranks == 1
    true_positives = right[order].cumsum(0)[accepted - 1]
    false_negatives = answerable - (ranks[order] > 0).cumsum(0)[accepted - 1]
    counted = accepted if wrong is None else (right | wrong)[order].cumsum(0)[accepted - 1]
    precision = true_positives.float() / counted.clamp(min=1)
    recall = true_positives.float() / (true_positives + false_negatives).clamp(min=1)
    begin = min(int((counted == 0).sum()), len(counted) - 1)
    return precision[begin:], recall[begin:], top[last_of_equals][begin:]


def _count_answerable(ranks: Tensor, radius: float) -> int:
    answerable = int((ranks > 0).sum())
    if not answerable:
        raise DataError(
            f"radius {radius:g} m: 0 of {len(ranks)} queries have a database place within it; "
            "expected at least one; widen it, or check that both sides cover the same ground"
        )
    return answerable


def _check_pair(scores: Tensor, distances: Tensor) -> None:
    if scores.ndim != 2 or scores.shape != distances.shape or not scores.shape[1]:
        raise DataError(
            f"scores {tuple(scores.shape)} and distances {tuple(distances.shape)}: expected both "
            "(queries, database), with a database of at least one place; pass one of each per pair"
        )
    bad = int(scores.isnan().sum())
    if bad or not scores.is_floating_point():
        kind = str(scores.dtype).removeprefix("torch.")
        raise DataError(
            f"scores: {kind}, {bad} NaN; expected floats without NaN; look for empty scans"
        )
    bad = int((~(distances >= 0)).sum())
    if bad:
        raise DataError(f"distances: {bad} negative or NaN; expected metres; check the poses")


def check_radius(radius: float) -> float:
    """The radius, if it is above 0. Raises ConfigError otherwise."""
    return checks.positive("radius", radius, "metres")


def check_share(k: int, over: str) -> None:
    """Raise ConfigError unless ``k`` is a whole number of at least 1 and ``over`` an `Over`."""
    checks.count("k", k)
    checks.one_of("over", over, Over)
