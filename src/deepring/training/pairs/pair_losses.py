"""Losses of pairs: contrastive, for LocNet, and the cross-entropy of a match, for RINet."""

from abc import ABC, abstractmethod
from typing import NamedTuple, Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError
from deepring.training.scheme import Step

#: What is said where nothing tells a match.
EXPECTED_HEAD = (
    "expected a method with match_logits(first, second), such as RINet; choose another loss, such "
    "as contrastive"
)


@runtime_checkable
class PairHead(Protocol):
    """A method that tells from two descriptors whether they are of one place."""

    def match_logits(self, first: Tensor, second: Tensor) -> Tensor:
        """Logits (n,) that ``first[k]`` and ``second[k]``, (n, ...), are of one place."""
        ...


class PairDescriptors(NamedTuple):
    """n pairs of scans, described."""

    first: Tensor
    """(n, d), see `NetworkMethod.vectors`."""
    second: Tensor
    """(n, d)."""
    logits: Tensor | None
    """(n,) of a match, by a method that is a `PairHead`; None by others."""
    same: Tensor
    """(n,) bool: drawn as a pair of one place."""
    metres: Tensor
    """(n,) float32: distance between the two scans."""


class PairLoss(nn.Module, ABC):
    """Base class of losses of pairs.

    `Step.accuracy` is the share of pairs that are told right.
    """

    @abstractmethod
    def forward(self, pairs: PairDescriptors) -> Step:
        """Loss of a batch of pairs."""


class Contrastive(PairLoss):
    """1/(2n) Σ [y d² + (1 - y) [margin - d]₊²], d the Euclidean distance, y 1 for one place.

    Source: Hadsell et al., CVPR 2006, Eq. 4; LocNet (Yin et al., IV 2018). A pair counts as told
    right where d is below half the margin for one place, and above it for two.

    Args:
        margin: distance of descriptors beyond which two places cost nothing
    """

    def __init__(self, margin: float = 12.0) -> None:
        super().__init__()
        self.margin = checks.positive("loss.margin", margin)

    def forward(self, pairs: PairDescriptors) -> Step:
        """See `PairLoss`; ``parts`` has the share of pairs of two places within the margin."""
        distance = pair_distances(pairs)
        loss = contrastive(distance, pairs.same.to(distance.dtype), self.margin).mean() / 2
        right = (distance < self.margin / 2) == pairs.same
        others = distance[~pairs.same].detach()
        active = (others < self.margin).float().mean() if len(others) else others.new_zeros(())
        return Step(loss, right.float().mean(), {"active": active})


class SoftMatch(PairLoss):
    """Cross-entropy of the head's match, and the contrastive loss of the descriptors (RINet).

    Targets fall with the metres between two scans: y = σ((middle - metres) / width), and 1 within
    ``certain`` metres. The loss is the mean cross-entropy of the logits, and ``contrastive`` times
    the mean of y d² + (1 - y) [margin - d]₊². Source: Li et al., RA-L 2022 (lilin-hitcrt/RINet).
    With ``contrastive`` 0 it is the cross-entropy alone.

    Args:
        middle: metres at which a match is as likely as none
        width: metres over which it falls
        certain: metres within which it is certain
        margin: of the descriptors of two places
        contrastive: weight of the contrastive loss
    """

    def __init__(
        self,
        middle: float = 10.0,
        width: float = 1.5,
        certain: float = 3.0,
        margin: float = 0.2,
        contrastive: float = 1.0,
    ) -> None:
        super().__init__()
        self.middle = checks.positive("loss.middle", middle, "metres")
        self.width = checks.positive("loss.width", width, "metres")
        self.certain = checks.at_least("loss.certain", certain, 0, "metres")
        self.margin = checks.positive("loss.margin", margin)
        self.contrastive = checks.at_least("loss.contrastive", contrastive, 0)

    def targets(self, metres: Tensor) -> Tensor:
        """How much pairs so many metres apart (n,) are of one place, in [0, 1]."""
        soft = torch.sigmoid((self.middle - metres) / self.width)
        return torch.where(metres < self.certain, torch.ones_like(soft), soft)

    def forward(self, pairs: PairDescriptors) -> Step:
        """See `PairLoss`; ``parts`` has both terms. Raises ConfigError without logits."""
        if pairs.logits is None:
            raise ConfigError(f"loss: SoftMatch, {EXPECTED_HEAD}")
        target = self.targets(pairs.metres)
        match = F.binary_cross_entropy_with_logits(pairs.logits, target)
        apart = contrastive(pair_distances(pairs), target, self.margin).mean()
        right = (pairs.logits > 0) == (target > 0.5)
        parts = {"match": match.detach(), "contrastive": apart.detach()}
        return Step(match + self.contrastive * apart, right.float().mean(), parts)


def pair_distances(pairs: PairDescriptors) -> Tensor:
    """Euclidean distances (n,) of the vectors of each pair."""
    # The root's gradient is infinite at 0.
    return ((pairs.first - pairs.second).square().sum(dim=-1) + 1e-12).sqrt()


def contrastive(distance: Tensor, same: Tensor, margin: float) -> Tensor:
    """y d² + (1 - y) [margin - d]₊² of distances (n,) and targets y (n,) in [0, 1]."""
    beyond = (margin - distance).clamp_min(0)
    return same * distance.square() + (1 - same) * beyond.square()
