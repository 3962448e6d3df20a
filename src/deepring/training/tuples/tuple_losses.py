"""Losses of tuples: what PointNetVLAD and DiSCO train with."""

from abc import ABC, abstractmethod
from typing import Literal, NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring import checks
from deepring.core.phase import phase_curves
from deepring.training.scheme import Step

CountedPositive = Literal["nearest", "farthest"]
"""Which of a tuple's positives counts."""


class TupleDescriptors(NamedTuple):
    """Descriptors of t tuples of k scans each, in the order of `TupleBatch`."""

    vectors: Tensor
    """(t, k, d), see `NetworkMethod.vectors`."""
    descriptors: Tensor
    """(t, k, ...), as the network gives them."""
    positives: int
    """Positives per tuple."""
    turn: Tensor
    """(t,) int64: sectors by which the query is turned against its positives."""


class TupleLoss(nn.Module, ABC):
    """Base of the losses of tuples. `Step.accuracy` is the share of queries of which a positive is
    nearer than all negatives."""

    @abstractmethod
    def forward(self, tuples: TupleDescriptors) -> Step:
        """Loss of a batch of tuples."""


class LazyQuadruplet(TupleLoss):
    """max_n [m₁ + d(q, p) - d(q, n)]₊ + max_n [m₂ + d(q, p) - d(n, n*)]₊ (PointNetVLAD, Eq. 4).

    d is the squared Euclidean distance, as in the published code (mikacuy/pointnetvlad), n* the
    tuple's last negative. PointNetVLAD takes the nearest positive, DiSCO the farthest.
    """

    def __init__(
        self,
        margin: float = 0.5,
        second_margin: float = 0.2,
        positive: CountedPositive = "nearest",
    ) -> None:
        super().__init__()
        self.margin = checks.positive("loss.margin", margin)
        self.second_margin = checks.positive("loss.second_margin", second_margin)
        self.positive = checks.one_of("loss.positive", positive, CountedPositive)

    def forward(self, tuples: TupleDescriptors) -> Step:
        """See `TupleLoss`; ``parts`` tell the share of tuples whose first term is ``active``."""
        vectors, last_positive = tuples.vectors, 1 + tuples.positives
        query, other = vectors[:, :1], vectors[:, -1:]
        own = _squared(query, vectors[:, 1:last_positive])  # (t, positives)
        negatives = vectors[:, last_positive:-1]
        wrong = _squared(query, negatives)  # (t, negatives)
        near = own.amin(dim=1) if self.positive == "nearest" else own.amax(dim=1)
        first = (self.margin + near[:, None] - wrong).clamp_min(0).amax(dim=1)
        apart = _squared(other, negatives)
        second = (self.second_margin + near[:, None] - apart).clamp_min(0).amax(dim=1)
        accuracy = (own.amin(dim=1) < wrong.amin(dim=1)).float().mean()
        active = (first > 0).float().mean()
        return Step((first + second).mean(), accuracy.detach(), {"active": active.detach()})


class TurnCrossEntropy(nn.Module):
    """Cross-entropy of the query's turn against each positive, by their phase correlation.

    The correlation's magnitudes are summed over r, times a learned scale, and softmax over θ
    (DiSCO, Sec. III-D; Corr2Softmax in MaverickPeter/DiSCO-pytorch, which starts at 200).
    """

    def __init__(self, scale: float = 200.0) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.tensor(float(scale)))

    def forward(self, queries: Tensor, positives: Tensor, turn: Tensor) -> Tensor:
        """Scalar, of maps (t, θ, r), (t, p, θ, r) and turns (t,) in rows, summed as published."""
        curves = phase_curves(queries[:, None], positives)  # (t, p, θ, r)
        logits = (self.scale * curves.abs()).sum(dim=-1)
        targets = turn[:, None].expand(logits.shape[:2]).flatten()
        return F.cross_entropy(logits.flatten(0, 1), targets, reduction="sum")


class QuadrupletWithTurn(TupleLoss):
    """DiSCO's: the lazy quadruplet loss of the signatures, plus the cross-entropy of the turn."""

    def __init__(
        self, margin: float = 0.5, second_margin: float = 0.2, turn_scale: float = 200.0
    ) -> None:
        super().__init__()
        self.quadruplet = LazyQuadruplet(margin, second_margin, "farthest")
        self.turn = TurnCrossEntropy(turn_scale)

    def forward(self, tuples: TupleDescriptors) -> Step:
        """See `TupleLoss`; the descriptors are feature maps (t, k, θ, r), ``parts`` both terms."""
        value = self.quadruplet(tuples)
        maps = tuples.descriptors
        turn = self.turn(maps[:, 0], maps[:, 1 : 1 + tuples.positives], tuples.turn)
        parts = {**value.parts, "quadruplet": value.loss.detach(), "turn": turn.detach()}
        return Step(value.loss + turn, value.accuracy, parts)


def _squared(a: Tensor, b: Tensor) -> Tensor:
    return (a - b).square().sum(dim=-1)
