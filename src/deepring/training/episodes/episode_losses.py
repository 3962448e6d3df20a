"""Losses of an episode: the paper's cross-entropy, and the triplet and quadruplet losses.

All use the similarity of each query with each way under the method's own measure. For L2 that is
the negative distance, so that differences of scores are differences of distances and the margins
are those of the literature.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring.checks import one_of, positive
from deepring.errors import ConfigError
from deepring.training.scheme import Mining, Step

Score = Callable[[Tensor, Tensor], Tensor]
"""Similarity (q, d) of descriptors (q, ...) and (d, ...); higher is more similar."""


class EpisodeLoss(nn.Module, ABC):
    """Base class of losses of an episode."""

    @abstractmethod
    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """Loss of descriptors (q, ...), support (ways, shots, ...) and the queries' ways (q,)."""


def class_scores(queries: Tensor, support: Tensor, score: Score) -> Tensor:
    """Scores (q, ways) of queries (q, ...) with support (ways, shots, ...).

    The score of a way is that of its best shot, as in retrieval.
    """
    ways, shots = support.shape[:2]
    return score(queries, support.flatten(0, 1)).view(len(queries), ways, shots).amax(dim=-1)


class OneShotClassifier(nn.Module):
    """Logits W C + b of the scores C, whose softmax is over the ways (paper, Eq. 9).

    b, as in the paper, cancels in the softmax and has no gradient. W is an inverse temperature; at
    the paper's learning rate it hardly changes, so that its initial value is a hyperparameter (100
    for descriptors of unit norm).
    """

    def __init__(self, temperature_scale: float = 100.0) -> None:
        super().__init__()
        positive("loss.temperature_scale", temperature_scale)
        self.weight = nn.Parameter(torch.tensor(float(temperature_scale)))
        self.bias = nn.Parameter(torch.zeros(()))

    def forward(self, queries: Tensor, support: Tensor, score: Score) -> Tensor:
        """Logits (q, ways) of descriptors (q, θ, ω) against support (ways, shots, θ, ω)."""
        return self.weight * class_scores(queries, support, score) + self.bias


class OneShotCrossEntropy(EpisodeLoss):
    """Cross-entropy of the one-shot classifier (paper, after Eq. 9).

    Args:
        temperature_scale: factor of the scores before the softmax, to begin with: it is
            learned
    """

    def __init__(self, temperature_scale: float = 100.0) -> None:
        super().__init__()
        self.classifier = OneShotClassifier(temperature_scale)

    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """See `EpisodeLoss`; ``parts`` has the current ``W``."""
        logits = self.classifier(queries, support, score)
        parts = {"W": self.classifier.weight.detach()}
        return Step(F.cross_entropy(logits, targets), _accuracy(logits, targets), parts)


class Triplet(EpisodeLoss):
    """[margin + d(query, own way) - d(query, other way)]₊ (paper, Sec. VI-D, "Loss").

    With ``mining='hardest'`` the other way is the most similar one (the lazy form of PointNetVLAD,
    mikacuy/pointnetvlad); 'all' takes the mean over all other ways.

    Args:
        margin: by which another way has to be farther than the own one
        mining: hardest or all
    """

    def __init__(self, margin: float = 0.5, mining: Mining = "hardest") -> None:
        super().__init__()
        self.margin = positive("loss.margin", margin)
        self.mining = one_of("loss.mining", mining, Mining)

    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """See `EpisodeLoss`."""
        scores = class_scores(queries, support, score)
        return Step(self.of_scores(scores, targets), _accuracy(scores, targets), {})

    def of_scores(self, scores: Tensor, targets: Tensor) -> Tensor:
        """Scalar loss of scores (q, ways) for queries whose ways are ``targets`` (q,)."""
        negatives = ~F.one_hot(targets, scores.shape[1]).bool()
        violation = (self.margin + scores - _target_scores(scores, targets)[:, None]).clamp_min(0)
        return _mine(violation, negatives, self.mining).mean()


class Quadruplet(EpisodeLoss):
    """The triplet loss plus [second_margin + d(query, own way) - d(way, another way)]₊.

    Neither way of the second term is the query's own (mikacuy/pointnetvlad, whose margins are
    the defaults; DiSCO uses the same).

    Args:
        margin: of the triplet
        second_margin: of the second term
        mining: hardest or all
    """

    def __init__(
        self, margin: float = 0.5, second_margin: float = 0.2, mining: Mining = "hardest"
    ) -> None:
        super().__init__()
        self.triplet = Triplet(margin, mining)
        self.second_margin = positive("loss.second_margin", second_margin)
        self.mining = mining

    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """See `EpisodeLoss`. Raises ConfigError for fewer than 3 ways."""
        ways, shots = support.shape[:2]
        if ways < 3:
            raise ConfigError(
                f"sampling.ways: {ways}, expected at least 3 for the quadruplet loss, which "
                "compares the query with two ways besides its own"
            )
        scores = class_scores(queries, support, score)
        first = self.triplet.of_scores(scores, targets)
        similarity = class_scores(support.flatten(0, 1), support, score)  # (ways * shots, ways)
        similarity = similarity.view(ways, shots, ways).amax(dim=1)
        number = torch.arange(ways, device=similarity.device)
        upper = number[:, None] < number[None, :]
        negatives = number[None] != targets[:, None]  # (q, ways)
        pairs = upper & negatives[:, :, None] & negatives[:, None, :]  # (q, ways, ways)
        target_scores = _target_scores(scores, targets)
        violation = (self.second_margin + similarity - target_scores[:, None, None]).clamp_min(0)
        second = _mine(violation.flatten(1), pairs.flatten(1), self.mining).mean()
        return Step(first + second, _accuracy(scores, targets), {})


def _accuracy(scores: Tensor, targets: Tensor) -> Tensor:
    return (scores.argmax(dim=-1) == targets).float().mean()


def _target_scores(scores: Tensor, targets: Tensor) -> Tensor:
    return scores.gather(1, targets[:, None]).squeeze(1)


def _mine(violation: Tensor, mask: Tensor, mining: Mining) -> Tensor:
    """Largest or mean (q,) of the non-negative violations (q, n) in the mask."""
    values = violation * mask
    return values.amax(dim=1) if mining == "hardest" else values.sum(dim=1) / mask.sum(dim=1)
