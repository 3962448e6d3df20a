"""Losses of tuples and of whole batches: what PointNetVLAD, DiSCO and EgoNN train with."""

from typing import Literal, NamedTuple, get_args

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring.core.phase import phase_curves
from deepring.errors import DeepringError
from deepring.training.losses import Mining, expect_mining

Positive = Literal["nearest", "farthest"]
"""Which of a tuple's positives counts."""


class TupleLoss(NamedTuple):
    """What a loss makes of tuples or of a batch."""

    loss: Tensor
    """Scalar, to be minimised."""
    accuracy: Tensor
    """Share of queries with a scan of their place nearer than all of other places."""
    parts: dict[str, Tensor]
    """What else is worth a curve, detached."""


class LazyQuadruplet(nn.Module):
    """max_n [m₁ + d(q, p) - d(q, n)]₊ + max_n [m₂ + d(q, p) - d(n, n*)]₊ (PointNetVLAD, Eq. 4).

    d is the squared Euclidean distance, as in the published code (mikacuy/pointnetvlad), n* the
    tuple's last negative. PointNetVLAD takes the nearest positive, DiSCO the farthest.
    """

    def __init__(
        self, margin: float = 0.5, second_margin: float = 0.2, positive: Positive = "nearest"
    ) -> None:
        super().__init__()
        for name, value in (("margin", margin), ("second_margin", second_margin)):
            if not value > 0:
                raise DeepringError(f"loss.{name}: {value}, expected more than 0")
        if positive not in get_args(Positive):
            raise DeepringError(f"loss.positive: {positive!r}, expected 'nearest' or 'farthest'")
        self.margin, self.second_margin, self.positive = margin, second_margin, positive

    def forward(self, vectors: Tensor, positives: int) -> TupleLoss:
        """Of vectors (t, 1 + positives + negatives + 1, d)."""
        query, other = vectors[:, :1], vectors[:, -1:]
        own = _squared(query, vectors[:, 1 : 1 + positives])  # (t, positives)
        negatives = vectors[:, 1 + positives : -1]
        wrong = _squared(query, negatives)  # (t, negatives)
        near = own.amin(dim=1) if self.positive == "nearest" else own.amax(dim=1)
        first = (self.margin + near[:, None] - wrong).clamp_min(0).amax(dim=1)
        apart = _squared(other, negatives)
        second = (self.second_margin + near[:, None] - apart).clamp_min(0).amax(dim=1)
        accuracy = (own.amin(dim=1) < wrong.amin(dim=1)).float().mean()
        active = (first > 0).float().mean()
        return TupleLoss((first + second).mean(), accuracy.detach(), {"active": active.detach()})


class YawCrossEntropy(nn.Module):
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


class BatchHardTriplet(nn.Module):
    """[margin + max d(a, p) - min d(a, n)]₊, the hardest positive and negative of each scan.

    d is the Euclidean distance. The mean is over triplets that are not zero, as in
    pytorch-metric-learning's reducer, which EgoNN takes (jac99/Egonn, models/loss.py). From
    random weights hardest triplets may pull all descriptors into one point and hold them there;
    ``mining='all'`` takes all triplets of the batch.
    """

    def __init__(self, margin: float = 0.2, mining: Mining = "hardest") -> None:
        super().__init__()
        if not margin > 0:
            raise DeepringError(f"loss.margin: {margin}, expected more than 0")
        self.margin, self.mining = margin, expect_mining("loss.mining", mining)

    def forward(self, vectors: Tensor, same: Tensor, different: Tensor) -> TupleLoss:
        """Of vectors (b, d) and masks (b, b) bool; scans without either count for nothing."""
        # The root's gradient is infinite at 0.
        apart = (_squared(vectors[:, None], vectors[None]) + 1e-12).sqrt()
        usable = same.any(dim=1) & different.any(dim=1)
        own = apart.masked_fill(~same, -torch.inf).amax(dim=1)[usable]
        wrong = apart.masked_fill(~different, torch.inf).amin(dim=1)[usable]
        violation = self.margin + own - wrong
        if self.mining == "all":
            triplets = same[:, :, None] & different[:, None, :]
            violation = (self.margin + apart[:, :, None] - apart[:, None, :])[triplets]
        violation = violation.clamp_min(0)
        active = violation > 0
        loss = violation.sum() / active.sum().clamp_min(1)
        share = active.float().mean() if len(active) else vectors.new_zeros(())
        accuracy = (own < wrong).float().mean() if len(own) else vectors.new_zeros(())
        return TupleLoss(loss, accuracy.detach(), {"active": share})


class QuadrupletWithYaw(nn.Module):
    """DiSCO's: the lazy quadruplet loss of the signatures, plus the yaw's cross-entropy."""

    def __init__(
        self, margin: float = 0.5, second_margin: float = 0.2, yaw_scale: float = 200.0
    ) -> None:
        super().__init__()
        self.quadruplet = LazyQuadruplet(margin, second_margin, "farthest")
        self.yaw = YawCrossEntropy(yaw_scale)

    def forward(self, vectors: Tensor, maps: Tensor, positives: int, turn: Tensor) -> TupleLoss:
        """Of signatures (t, k, d), feature maps (t, k, θ, r) and the queries' turns (t,)."""
        value = self.quadruplet(vectors, positives)
        yaw = self.yaw(maps[:, 0], maps[:, 1 : 1 + positives], turn)
        parts = {**value.parts, "quadruplet": value.loss.detach(), "yaw": yaw.detach()}
        return TupleLoss(value.loss + yaw, value.accuracy, parts)


def _squared(a: Tensor, b: Tensor) -> Tensor:
    return (a - b).square().sum(dim=-1)
