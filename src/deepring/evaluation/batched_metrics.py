"""The metrics of `deepring.evaluation.metrics` over batches of queries, as torchmetrics classes.

Two numbers are stored per query, its top score and the rank of its first right place, so that
28 000 queries fit in a few hundred kilobytes. The retrieval classes of torchmetrics mean something
else: they drop scores that are not positive, and their recall is the share of all right places.

In a ``MetricCollection`` of several radii, set ``compute_groups=False``: its groups compare states
of the first batch alone, in which two radii may agree.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torchmetrics import Metric
from torchmetrics.utilities import dim_zero_cat

from deepring.evaluation.metrics import (
    Over,
    area_under,
    check_radius,
    check_share,
    curve_of_ranks,
    f1_along,
    first_right,
    recall_of_ranks,
)


class _PlaceMetric(Metric):
    """Top score and first right rank of every query."""

    is_differentiable = False
    higher_is_better = True
    full_state_update = False

    scores: list[Tensor]
    ranks: list[Tensor]

    def __init__(self, radius: float, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.radius = float(check_radius(radius))
        # A process that saw no query contributes an empty tensor of the metric's dtype, and
        # what is gathered must agree: float32 for all states, whatever torch's default is.
        self.set_dtype(torch.float32)
        self.add_state("scores", default=[], dist_reduce_fx="cat")
        self.add_state("ranks", default=[], dist_reduce_fx="cat")

    def update(self, scores: Tensor, distances: Tensor) -> None:
        """Add a batch of queries: scores and distances (q, d); see ``first_right``."""
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
        check_share(k, over)
        self.k = k
        self.over: Over = over

    def compute(self) -> Tensor:
        """Recall@K of all queries so far, 0-dimensional float32."""
        return recall_of_ranks(self._queries()[1], self.k, self.radius, self.over)


class PlacePrecisionRecall(_PlaceMetric):
    """``place_precision_recall`` over batches of queries; arguments and errors as there.

    >>> metric = PlacePrecisionRecall(radius=10.0)
    >>> metric.update(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]))
    >>> metric.compute()
    (tensor([0.0000, 0.5000]), tensor([0., 1.]), tensor([0.9000, 0.1000]))
    """

    def compute(self) -> tuple[Tensor, Tensor, Tensor]:
        """Precision, recall and thresholds (t,), the highest threshold first."""
        return curve_of_ranks(*self._queries(), self.radius)

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
        return f1_along(*curve_of_ranks(*self._queries(), self.radius)[:2]).amax()


class PlaceAUC(_PlaceMetric):
    """``place_auc`` over batches of queries; arguments and errors as there.

    >>> metric = PlaceAUC(radius=10.0)
    >>> metric.update(torch.tensor([[0.1], [0.9]]), torch.tensor([[4.0], [60.0]]))
    >>> metric.compute()
    tensor(0.2500)
    """

    def compute(self) -> Tensor:
        """Area under the curve of all queries so far, 0-dimensional float32."""
        return area_under(*curve_of_ranks(*self._queries(), self.radius)[:2])
