"""Losses of tuples, for PointNetVLAD and DiSCO."""

from abc import ABC, abstractmethod
from typing import Literal, NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring import checks
from deepring.core.phase import phase_curves
from deepring.errors import ConfigError
from deepring.methods.network import NetworkMethod
from deepring.training.scheme import Step

CountedPositive = Literal["nearest", "farthest"]
"""The positive of a tuple that counts."""


class TupleDescriptors(NamedTuple):
    """Descriptors of t tuples of k scans each, in the order of `TupleBatch`."""

    vectors: Tensor
    """(t, k, d), see `NetworkMethod.vectors`."""
    descriptors: Tensor
    """(t, k, ...), the output of the network."""
    positives: int
    """Positives per tuple."""
    turn: Tensor
    """(t,) int64: turn of the query relative to its positives, sectors."""


class TupleLoss(nn.Module, ABC):
    """Base class of losses of tuples.

    `Step.accuracy` is the share of queries with a positive nearer than all negatives."""

    @abstractmethod
    def forward(self, tuples: TupleDescriptors) -> Step:
        """Loss of a batch of tuples."""

    def expect(self, method: NetworkMethod, *, turned: bool) -> None:
        """Raise ConfigError for a method or a sampling that does not serve; takes any here."""


class LazyQuadruplet(TupleLoss):
    """max_n [m₁ + d(q, p) - d(q, n)]₊ + max_n [m₂ + d(q, p) - d(n, n*)]₊ (PointNetVLAD, Eq. 4).

    d is the squared Euclidean distance, as in the published code (mikacuy/pointnetvlad), n* the
    tuple's last negative. PointNetVLAD uses the nearest positive, DiSCO the farthest.

    Args:
        margin: m₁, of the query and a negative
        second_margin: m₂, of two negatives
        positive: which positive counts: nearest or farthest
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
        """See `TupleLoss`; ``parts`` has the share of tuples whose first term is ``active``."""
        vectors, last_positive = tuples.vectors, 1 + tuples.positives
        query, last_negative = vectors[:, :1], vectors[:, -1:]
        negatives = vectors[:, last_positive:-1]
        to_positives = _squared_distance(query, vectors[:, 1:last_positive])  # (t, positives)
        to_negatives = _squared_distance(query, negatives)  # (t, negatives)
        nearest = to_positives.amin(dim=1)
        positive = nearest if self.positive == "nearest" else to_positives.amax(dim=1)
        first = (self.margin + positive[:, None] - to_negatives).clamp_min(0).amax(dim=1)
        between = _squared_distance(last_negative, negatives)
        second = (self.second_margin + positive[:, None] - between).clamp_min(0).amax(dim=1)
        accuracy = (nearest < to_negatives.amin(dim=1)).float().mean()
        active = (first > 0).float().mean()
        return Step((first + second).mean(), accuracy.detach(), {"active": active.detach()})


class TurnCrossEntropy(nn.Module):
    """Cross-entropy of the turn between query and positives, from their phase correlation.

    Logits over θ are the magnitudes of the correlation, summed over r, times a learned scale
    (DiSCO, Sec. III-D; Corr2Softmax in MaverickPeter/DiSCO-pytorch, which starts at 200). The rows
    of a map are the sectors that scans are turned by.
    """

    def __init__(self, scale: float = 200.0) -> None:
        super().__init__()
        checks.positive("loss.turn_scale", scale)
        self.scale = nn.Parameter(torch.tensor(float(scale)))

    def forward(self, queries: Tensor, positives: Tensor, turn: Tensor) -> Tensor:
        """Scalar sum for maps (t, θ, r) and (t, p, θ, r) and turns (t,) in rows, as published."""
        curves = phase_curves(queries[:, None], positives)  # (t, p, θ, r)
        logits = (self.scale * curves.abs()).sum(dim=-1)
        targets = turn[:, None].expand(logits.shape[:2]).flatten()
        return F.cross_entropy(logits.flatten(0, 1), targets, reduction="sum")

    def expect(self, method: NetworkMethod, *, turned: bool) -> None:
        """Raise ConfigError for descriptors that are no maps, or scans that are not turned."""
        if not turned:
            raise ConfigError(
                "sampling.turned: false, expected true, since the loss learns the turns that are "
                "drawn; choose a loss without turns otherwise"
            )
        shape: tuple[int, ...] = getattr(method, "descriptor_shape", ())
        sectors = method.raster.sectors
        if len(shape) != 2 or shape[0] != sectors:
            raise ConfigError(
                f"loss: learns turns, expected a method whose descriptors are maps (θ, r) of the "
                f"raster's {sectors} sectors, such as DiSCO, not {method.settings.label} with "
                f"{shape}; choose a loss without turns or another method"
            )


class QuadrupletWithTurn(TupleLoss):
    """DiSCO's loss: lazy quadruplet of the signatures, plus cross-entropy of the turn.

    Args:
        margin: as in `LazyQuadruplet`
        second_margin: as there
        turn_scale: factor of the correlation before the softmax over turns
    """

    def __init__(
        self, margin: float = 0.5, second_margin: float = 0.2, turn_scale: float = 200.0
    ) -> None:
        super().__init__()
        self.quadruplet = LazyQuadruplet(margin, second_margin, "farthest")
        self.turn = TurnCrossEntropy(turn_scale)

    def forward(self, tuples: TupleDescriptors) -> Step:
        """See `TupleLoss`; descriptors are feature maps (t, k, θ, r), ``parts`` has both terms."""
        step = self.quadruplet(tuples)
        maps = tuples.descriptors
        turn = self.turn(maps[:, 0], maps[:, 1 : 1 + tuples.positives], tuples.turn)
        parts = {**step.parts, "quadruplet": step.loss.detach(), "turn": turn.detach()}
        return Step(step.loss + turn, step.accuracy, parts)

    def expect(self, method: NetworkMethod, *, turned: bool) -> None:
        """See `TurnCrossEntropy.expect`."""
        self.turn.expect(method, turned=turned)


def _squared_distance(a: Tensor, b: Tensor) -> Tensor:
    return (a - b).square().sum(dim=-1)
