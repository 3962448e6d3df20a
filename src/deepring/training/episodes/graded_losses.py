"""Losses whose targets are made of distances: a query may belong to several ways, more or less.

One-hot targets call every other way equally wrong. Where ways lie close to each other, along a
street or in a map, the query often stands between two of them.
"""

from abc import abstractmethod

import torch
from torch import Tensor

from deepring.checks import positive
from deepring.training.episodes.episode_losses import (
    EpisodeLoss,
    OneShotClassifier,
    Score,
    class_scores,
)
from deepring.training.scheme import Step


class GradedLoss(EpisodeLoss):
    """Base class of losses of an episode with targets by distance."""

    @abstractmethod
    def targets(self, distances: Tensor) -> Tensor:
        """What `forward` takes as targets, (q, ways) of 0 and more.

        Args:
            distances: (q, ways, shots) metres between queries and shots, huge between datasets.
        """


def graded_targets(distances: Tensor, scale: float) -> Tensor:
    """A distribution over ways: the softmax of -(d / scale)², (q, ways).

    Args:
        distances: (q, ways) metres, with at least one finite value in each row.
        scale: metres; a way that is nearer by some, d₂² - d₁² = scale², counts e times as much.

    >>> graded_targets(torch.tensor([[0.0, 10.0, torch.inf]]), 10.0)
    tensor([[0.7311, 0.2689, 0.0000]])
    """
    # In half precision the squares of metres would overflow.
    return torch.softmax(-(distances.float() / scale).square(), dim=1)


class GradedCrossEntropy(GradedLoss):
    """Cross-entropy of the one-shot classifier with `graded_targets`, in place of one way.

    A way is as far from a query as its nearest shot. With a ``scale`` far below the distances
    between ways the targets are those of `OneShotCrossEntropy`.

    Args:
        temperature_scale: as in `OneShotCrossEntropy`
        scale: metres over which a target falls with the distance
    """

    def __init__(self, temperature_scale: float = 100.0, scale: float = 10.0) -> None:
        super().__init__()
        self.classifier = OneShotClassifier(temperature_scale)
        self.scale = positive("loss.scale", scale, "metres")

    def targets(self, distances: Tensor) -> Tensor:
        """Shares (q, ways) that add up to 1."""
        return graded_targets(distances.amin(dim=2), self.scale)

    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """See `EpisodeLoss`; ``targets`` are shares (q, ways).

        ``parts`` has the current ``W``, and the ``entropy`` of the targets, below which the loss
        cannot fall.
        """
        logits = self.classifier(queries, support, score)
        loss = -(targets * logits.log_softmax(dim=1)).sum(dim=1).mean()
        entropy = torch.special.entr(targets).sum(dim=1).mean()
        right = logits.argmax(dim=1) == targets.argmax(dim=1)
        parts = {"W": self.classifier.weight.detach(), "entropy": entropy}
        return Step(loss, right.float().mean(), parts)


class SmoothAp(GradedLoss):
    """1 - the average precision of the ways, each rank a sum of sigmoids.

    A way within ``radius`` of the query is relevant. Queries without such a way do not count.

    Source: Brown et al., Smooth-AP, ECCV 2020, Eq. 6; its τ is ``temperature``.

    Args:
        radius: metres within which a way is relevant
        temperature: of the sigmoids; a smaller one is closer to true ranks
    """

    def __init__(self, radius: float = 10.0, temperature: float = 0.01) -> None:
        super().__init__()
        self.radius = positive("loss.radius", radius, "metres")
        self.temperature = positive("loss.temperature", temperature)

    def targets(self, distances: Tensor) -> Tensor:
        """1 for relevant ways and 0 for others, (q, ways)."""
        return (distances.amin(dim=2) <= self.radius).float()

    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """See `EpisodeLoss`; ``targets`` are 0 or 1, (q, ways)."""
        scores = class_scores(queries, support, score)
        above = torch.sigmoid((scores[:, None] - scores[:, :, None]) / self.temperature)
        above = above * ~torch.eye(scores.shape[1], dtype=torch.bool, device=scores.device)
        rank = 1 + above.sum(dim=2)  # (q, ways)
        among_relevant = 1 + (above * targets[:, None]).sum(dim=2)
        relevant = targets.sum(dim=1)
        precision = (among_relevant / rank * targets).sum(dim=1) / relevant.clamp_min(1)
        usable = relevant > 0
        best = targets.gather(1, scores.argmax(dim=1, keepdim=True)).squeeze(1)
        number = usable.sum().clamp_min(1)
        loss = ((1 - precision) * usable).sum() / number
        return Step(loss, ((best * usable).sum() / number).detach(), {})
