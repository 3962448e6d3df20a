"""Retrieval metrics of the evaluation protocol: Recall@K, precision-recall, max-F1 and its AUC.

Each metric is a function on whole matrices and a torchmetrics class that takes queries in batches.
Both reduce a query to two numbers, its top score and the rank of its first right place, so that
28 000 queries fit in a few hundred kilobytes.

A retrieval is right when the retrieved place lies within the radius; a query is answerable when
some database place does. torchmetrics' own retrieval classes mean something else: they drop scores
that are not positive, and their recall is the share of all right places that were found.
"""

import math
from collections.abc import Callable
from typing import Any, Literal

import torch
from torch import Tensor
from torchmetrics import Metric
from torchmetrics.utilities import dim_zero_cat

from deepring.errors import DeepringError

Over = Literal["answerable", "all"]  # the queries that Recall@K is a share of


def first_right(scores: Tensor, distances: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Reduce each query to its top score and the rank of its first right place.

    Args:
        scores: (q, d) floating, of any scale and sign; higher is better, equals rank by index.
        distances: (q, d) metres from each query to each database place.
        radius: revisit radius in metres; a place at exactly this distance is right.

    Returns:
        Top score (q,) float32, and rank (q,) int64, counted from 1; 0 where unanswerable.

    Raises:
        DeepringError: shapes that differ, an empty database, NaN, or a negative distance.

    >>> first_right(torch.tensor([[0.9, 0.5]]), torch.tensor([[40.0, 3.0]]), radius=10.0)
    (tensor([0.9000]), tensor([2]))
    """
    _check_radius(radius)
    _check_pair(scores, distances)
    right = distances <= radius
    best_right = scores.masked_fill(~right, -math.inf).amax(dim=1, keepdim=True)
    # argmax over booleans as integers: the first of equals, also where the score is -inf
    index = (right & (scores == best_right)).int().argmax(dim=1, keepdim=True)
    earlier = torch.arange(scores.shape[1], device=scores.device) < index
    ahead = (scores > best_right) | ((scores == best_right) & earlier)
    rank = torch.where(right.any(dim=1), ahead.sum(dim=1) + 1, 0)
    return scores.amax(dim=1).float(), rank


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
        DeepringError: as ``first_right``; a bad ``k`` or ``over``; no answerable query.

    >>> scores, distances = torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]])
    >>> recall_at_k(scores, distances, k=1, radius=10.0)
    tensor(1.)
    >>> recall_at_k(scores, distances, k=1, radius=10.0, over="all")
    tensor(0.5000)
    """
    _check_share(k, over)
    return _recall(first_right(scores, distances, radius)[1], k, radius, over)


def place_precision_recall(
    scores: Tensor, distances: Tensor, radius: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Precision and recall at every distinct top score, the highest threshold first.

    One decision a query: its top place is accepted when its score reaches the threshold. Accepted
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
    return _curve(*first_right(scores, distances, radius), radius)


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


class _PlaceMetric(Metric):
    """Top score and first right rank of every query; metrics of one radius share them."""

    is_differentiable = False
    higher_is_better = True
    full_state_update = False

    scores: list[Tensor]
    ranks: list[Tensor]

    def __init__(self, radius: float, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        _check_radius(radius)
        self.radius = float(radius)
        # A process that saw no query contributes an empty tensor of the metric's dtype, and
        # what is gathered must agree: float32 for all states, whatever torch's default is.
        self.set_dtype(torch.float32)
        self.add_state("scores", default=[], dist_reduce_fx="cat")
        self.add_state("ranks", default=[], dist_reduce_fx="cat")
        # A MetricCollection merges metrics whose states look alike after the first batch. This
        # state keeps two radii apart whose ranks happen to agree there.
        self.add_state("shared_radius", torch.tensor(self.radius), dist_reduce_fx="max")

    def update(self, scores: Tensor, distances: Tensor) -> None:
        """Take a batch of queries: scores and distances (q, d); see ``first_right``."""
        top, rank = first_right(scores, distances, self.radius)
        self.scores.append(top)
        self.ranks.append(rank.float())  # exact up to 2^24 places

    def _queries(self) -> tuple[Tensor, Tensor]:
        if not len(self.ranks):
            return torch.zeros(0), torch.zeros(0)
        return dim_zero_cat(self.scores), dim_zero_cat(self.ranks)


class RecallAtK(_PlaceMetric):
    """``recall_at_k`` over batches of queries; arguments and errors as there.

    ``compute`` raises where no query is answerable, as does calling the metric on such a batch.

    >>> metric = RecallAtK(k=1, radius=10.0)
    >>> metric.update(torch.tensor([[0.9, 0.5]]), torch.tensor([[40.0, 3.0]]))
    >>> metric.update(torch.tensor([[0.1, 0.3]]), torch.tensor([[60.0, 8.0]]))
    >>> metric.compute()
    tensor(0.5000)
    """

    def __init__(self, k: int, radius: float, over: Over = "answerable", **kwargs: Any) -> None:
        super().__init__(radius, **kwargs)
        _check_share(k, over)
        self.k = k
        self.over: Over = over

    def compute(self) -> Tensor:
        """Recall@K of all queries so far, 0-dimensional float32."""
        return _recall(self._queries()[1], self.k, self.radius, self.over)


class PlacePrecisionRecall(_PlaceMetric):
    """``place_precision_recall`` over batches of queries; arguments and errors as there.

    >>> metric = PlacePrecisionRecall(radius=10.0)
    >>> metric.update(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]))
    >>> metric.compute()
    (tensor([0.0000, 0.5000]), tensor([0., 1.]), tensor([0.9000, 0.1000]))
    """

    def compute(self) -> tuple[Tensor, Tensor, Tensor]:
        """Precision, recall and thresholds (t,), the highest threshold first."""
        return _curve(*self._queries(), self.radius)

    def _wrap_compute(self, compute: Callable) -> Callable:
        # torchmetrics squeezes values of one element, but a curve of one point is still a curve
        squeezed = super()._wrap_compute(compute)
        return lambda: tuple(values.reshape(-1) for values in squeezed())


class MaxF1(_PlaceMetric):
    """``max_f1`` over batches of queries; arguments and errors as there.

    >>> metric = MaxF1(radius=10.0)
    >>> metric.update(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]))
    >>> metric.compute()
    tensor(0.6667)
    """

    def compute(self) -> Tensor:
        """Highest F1 of all queries so far, 0-dimensional float32."""
        return f1_along(*_curve(*self._queries(), self.radius)[:2]).amax()


class PlaceAUC(_PlaceMetric):
    """``place_auc`` over batches of queries; arguments and errors as there.

    >>> metric = PlaceAUC(radius=10.0)
    >>> metric.update(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]))
    >>> metric.compute()
    tensor(0.2500)
    """

    def compute(self) -> Tensor:
        """Area under the curve of all queries so far, 0-dimensional float32."""
        return area_under(*_curve(*self._queries(), self.radius)[:2])


def _recall(ranks: Tensor, k: int, radius: float, over: Over) -> Tensor:
    answerable = _count_answerable(ranks, radius)
    found = ((ranks > 0) & (ranks <= k)).sum()
    return found.float() / (answerable if over == "answerable" else len(ranks))


def _curve(top: Tensor, ranks: Tensor, radius: float) -> tuple[Tensor, Tensor, Tensor]:
    answerable = _count_answerable(ranks, radius)
    top, order = top.sort(descending=True)
    last_of_equals = torch.cat([top[1:] != top[:-1], top.new_ones(1, dtype=torch.bool)])
    accepted = last_of_equals.nonzero().flatten() + 1
    true_positives = (ranks[order] == 1).cumsum(0)[accepted - 1]
    false_negatives = answerable - (ranks[order] > 0).cumsum(0)[accepted - 1]
    precision = true_positives.float() / accepted
    recall = true_positives.float() / (true_positives + false_negatives).clamp(min=1)
    return precision, recall, top[last_of_equals]


def _count_answerable(ranks: Tensor, radius: float) -> int:
    answerable = int((ranks > 0).sum())
    if not answerable:
        raise DeepringError(
            f"radius {radius:g} m: 0 of {len(ranks)} queries have a database place within it; "
            "expected at least one; widen it, or check that both cover the same ground"
        )
    return answerable


def _check_pair(scores: Tensor, distances: Tensor) -> None:
    if scores.ndim != 2 or scores.shape != distances.shape or not scores.shape[1]:
        raise DeepringError(
            f"scores {tuple(scores.shape)} and distances {tuple(distances.shape)}: expected both "
            "(queries, database), with a database of at least one place; pass one of each a pair"
        )
    bad = int(scores.isnan().sum())
    if bad or not scores.is_floating_point():
        kind = str(scores.dtype).removeprefix("torch.")
        raise DeepringError(f"scores: {kind}, {bad} NaN; expected floats; look for empty scans")
    bad = int((~(distances >= 0)).sum())
    if bad:
        raise DeepringError(f"distances: {bad} negative or NaN; expected metres; check the poses")


def _check_radius(radius: float) -> None:
    if not 0 < radius < math.inf:
        raise DeepringError(f"radius {radius}: expected metres, positive and finite, such as 10.0")


def _check_share(k: int, over: str) -> None:
    if k < 1 or k != int(k):
        raise DeepringError(f"k {k}: expected a whole number of places, at least 1")
    if over not in ("answerable", "all"):
        raise DeepringError(f"over {over!r}: expected 'answerable' or 'all'")
