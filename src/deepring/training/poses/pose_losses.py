"""The loss of pairs with a known pose: places by a triplet, the pose by where it puts points."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from torch import Tensor, nn

from deepring import checks
from deepring.methods.lcdnet.pose_head import Matches
from deepring.training.scheme import Step


class PosePairs(NamedTuple):
    """n pairs of scans of one place, described and matched."""

    vectors: Tensor
    """(2 n, d): of a scan of each pair, then of their partners."""
    negatives: Tensor
    """(n, 2 n) bool: scans at other places than the first scan of each pair."""
    lots: Tensor
    """(n, 2 n) random numbers, by which a negative is drawn."""
    matches: Matches
    """Where the partners' points are in the first scans."""
    transforms: Tensor
    """(n, 4, 4) that carry the partners' points onto those of the first scans."""


class PoseLoss(nn.Module, ABC):
    """Base class of losses of pairs with a pose."""

    @abstractmethod
    def forward(self, pairs: PosePairs) -> Step:
        """Loss of a batch of pairs."""


class TripletWithPose(PoseLoss):
    """[margin + d(a, p) - d(a, n)]₊ of one negative, the pose's error, and that of the matches.

    n is drawn at random from the scans of other places for which the triplet is not 0; the mean
    is over the pairs that have one. The pose's error is the mean of |T x - T* x| over the points x
    of the partner, T* the true transform, T that of the matches; the matches' that of |y - T* x|, y
    where x is matched. Metres and descriptors' distances are added as they are, with the weights.
    Source: Cattaneo et al., T-RO 2022, Sec. III-D.

    Args:
        margin: of the triplet
        pose_weight: weight of the pose's error, a metre of which costs as much
        match_weight: weight of the matches' error
    """

    def __init__(
        self, margin: float = 0.5, pose_weight: float = 1.0, match_weight: float = 0.05
    ) -> None:
        super().__init__()
        self.margin = checks.positive("loss.margin", margin)
        self.pose_weight = checks.at_least("loss.pose_weight", pose_weight, 0)
        self.match_weight = checks.at_least("loss.match_weight", match_weight, 0)

    def forward(self, pairs: PosePairs) -> Step:
        """See `PoseLoss`; ``parts`` has the three terms and the share of ``active`` triplets.

        The accuracy is the share of pairs that are nearer to each other than the first of them to
        any scan of another place.
        """
        first, second = pairs.vectors.chunk(2)
        own = distance(first, second)
        others = distance(first[:, None], pairs.vectors[None])
        triplet, active = self._triplet(own, others, pairs)
        points, matched = pairs.matches.points, pairs.matches.matched
        true = moved(points, pairs.transforms)
        pose = (moved(points, pairs.matches.transforms) - true).norm(dim=-1).mean()
        match = (matched - true).norm(dim=-1).mean()
        loss = triplet + self.pose_weight * pose + self.match_weight * match
        nearest = others.masked_fill(~pairs.negatives, torch.inf).amin(dim=1)
        parts = {"triplet": triplet, "pose": pose, "match": match, "active": active}
        return Step(
            loss,
            (own < nearest).float().mean().detach(),
            {name: value.detach() for name, value in parts.items()},
        )

    def _triplet(self, own: Tensor, others: Tensor, pairs: PosePairs) -> tuple[Tensor, Tensor]:
        """The mean over the pairs with a negative that violates the margin, and their share."""
        violation = self.margin + own[:, None] - others
        drawn = pairs.lots.masked_fill(~pairs.negatives | (violation <= 0), -1.0)
        chosen = drawn.argmax(dim=1, keepdim=True)
        active = drawn.gather(1, chosen)[:, 0] >= 0
        values = violation.gather(1, chosen)[:, 0] * active
        return values.sum() / active.sum().clamp_min(1), active.float().mean()


def distance(first: Tensor, second: Tensor) -> Tensor:
    """Euclidean distances (...) of vectors (..., d), which are spread over each other."""
    # The root's gradient is infinite at 0.
    return ((first - second).square().sum(dim=-1) + 1e-12).sqrt()


def moved(points: Tensor, transforms: Tensor) -> Tensor:
    """Points (n, k, 3) moved by transforms (n, 4, 4), in the points' type."""
    transforms = transforms.to(points)
    return points @ transforms[:, :3, :3].mT + transforms[:, None, :3, 3]
