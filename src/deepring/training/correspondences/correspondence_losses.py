"""Losses of points that two scans share: of their descriptors, and of where descriptors hold."""

from abc import ABC, abstractmethod
from typing import NamedTuple

from torch import Tensor, nn

from deepring import checks
from deepring.training.scheme import Step


class Correspondences(NamedTuple):
    """n pairs of scans, of each m points of the first, and the partner's points nearest to them."""

    distances: Tensor
    """(n, m, m) between the descriptors of points and partner's points."""
    metres: Tensor
    """(n, m, m) between the points and the partner's points, where the true pose carries these."""
    scores: Tensor
    """(n, m) in (0, 1): how far the points of the first scan can be relied on."""
    around: Tensor
    """(n, m, k) int64: the k nearest of the m points to each, itself first."""


class CorrespondenceLoss(nn.Module, ABC):
    """Base class of losses of corresponding points.

    ``radius`` metres: points so close are the same place. Points without a counterpart within it
    count as never found. `Step.accuracy` is the share of points with one whose nearest descriptor
    is at the same place.
    """

    def __init__(self, radius: float) -> None:
        super().__init__()
        self.radius = checks.positive("loss.radius", radius, "metres")

    @abstractmethod
    def forward(self, pairs: Correspondences) -> Step:
        """Loss of a batch of pairs."""

    def found(self, pairs: Correspondences) -> tuple[Tensor, Tensor]:
        """Whether the nearest descriptor is at the same place, and whether any is: (n, m) bool."""
        nearest = pairs.distances.detach().argmin(dim=-1, keepdim=True)
        found = pairs.metres.gather(-1, nearest)[..., 0] < self.radius
        return found, (pairs.metres < self.radius).any(dim=-1)


class NTuple(CorrespondenceLoss):
    """mean D of the same places + weight · mean [margin - D]₊ of others, D between descriptors.

    Others are from ``apart`` to ``far`` metres away; what lies between radius and ``apart``, and
    beyond ``far``, does not count. Source: the N-tuple loss of PPFNet (Deng et al., CVPR 2018), as
    DH3D takes it (ECCV 2020, Sec. 3.1).

    Args:
        radius: metres within which points are the same place
        apart: metres from which on points are others
        far: metres up to which they are
        margin: distance of descriptors beyond which others cost nothing
        weight: of the others
    """

    def __init__(
        self,
        radius: float = 0.5,
        apart: float = 1.0,
        far: float = 20.0,
        margin: float = 1.0,
        weight: float = 5.0,
    ) -> None:
        super().__init__(radius)
        self.apart = checks.at_least("loss.apart", apart, radius, "metres")
        self.far = checks.at_least("loss.far", far, apart, "metres")
        self.margin = checks.positive("loss.margin", margin)
        self.weight = checks.at_least("loss.weight", weight, 0)

    def forward(self, pairs: Correspondences) -> Step:
        """See `CorrespondenceLoss`; ``parts`` has both terms, and what ``found`` says."""
        same = pairs.metres < self.radius
        other = (pairs.metres > self.apart) & (pairs.metres < self.far)
        pull = _mean(pairs.distances, same)
        push = _mean((self.margin - pairs.distances).clamp_min(0), other)
        right, answerable = self.found(pairs)
        accuracy = _mean(right.float(), answerable).detach()
        parts = {"pull": pull.detach(), "push": push.detach(), "matched": accuracy}
        return Step(pull + self.weight * push, accuracy, parts)


class Reliability(CorrespondenceLoss):
    """mean 1 - [threshold (1 - s) + s r] of points with score s, r the success around them.

    r is the share of the nearest points, the point among them, whose nearest descriptor is at the
    same place: a score pays where descriptors succeed more often than ``threshold``. Source: DH3D
    (Sec. 3.2), after the average precision of R2D2 (Revaud et al., NeurIPS 2019).

    Args:
        radius: metres within which points are the same place
        threshold: share of successes from which on a high score pays
    """

    def __init__(self, radius: float = 0.5, threshold: float = 0.3) -> None:
        super().__init__(radius)
        self.threshold = checks.share("loss.threshold", threshold)

    def forward(self, pairs: Correspondences) -> Step:
        """See `CorrespondenceLoss`.

        ``parts`` has the success of all points, and ``kept``, that of points weighted by score: a
        detector is worth how much the second exceeds the first.
        """
        right, answerable = self.found(pairs)
        success = right.float()
        around = success.gather(1, pairs.around.flatten(1)).view(pairs.around.shape).mean(dim=-1)
        scores = pairs.scores
        loss = (1 - (self.threshold * (1 - scores) + scores * around)).mean()
        weights = scores.detach()
        kept = (weights * success).sum() / weights.sum().clamp_min(1e-9)
        parts = {"matched": success.mean(), "kept": kept}
        return Step(loss, _mean(success, answerable), parts)


def _mean(values: Tensor, counted: Tensor) -> Tensor:
    """The mean of the values that count; 0 where none does."""
    return (values * counted).sum() / counted.sum().clamp_min(1)
