"""Losses of an episode: the paper's cross-entropy, and the triplet and quadruplet losses.

All see an episode in the same way: how alike each query and each way are under the method's own
similarity. For L2 that is the negative distance, so that a difference of scores is a difference
of distances and the margins are those of the literature.
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
"""How alike descriptors (q, ...) and (d, ...) are, (q, d); higher is more alike."""


class EpisodeLoss(nn.Module, ABC):
    """Base of the losses of an episode."""

    @abstractmethod
    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """Loss of descriptors (q, ...), support (ways, shots, ...) and the queries' ways (q,)."""


def class_scores(queries: Tensor, support: Tensor, score: Score) -> Tensor:
    """How alike each of q queries and each way are, (q, ways), of support (ways, shots, ...).

    A class of several shots is as alike as its most alike shot, as in retrieval.
    """
    ways, shots = support.shape[:2]
    return score(queries, support.flatten(0, 1)).view(len(queries), ways, shots).amax(dim=-1)


class OneShotClassifier(nn.Module):
    """Logits W C + b of the scores C, whose softmax is over the ways (paper, Eq. 9).

    b is kept for the paper's sake: it cancels in the softmax and has no gradient. W is the
    inverse of a temperature; at the paper's learning rate it hardly moves from its start, so
    the start is a hyperparameter (100 for descriptors of unit norm).
    """

    def __init__(self, temperature_scale: float = 100.0) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.tensor(float(temperature_scale)))
        self.bias = nn.Parameter(torch.zeros(()))

    def forward(self, queries: Tensor, support: Tensor, score: Score) -> Tensor:
        """Logits (q, ways) of descriptors (q, θ, ω) against support (ways, shots, θ, ω)."""
        return self.weight * class_scores(queries, support, score) + self.bias


class OneShotCrossEntropy(EpisodeLoss):
    """Cross-entropy of the one-shot classifier (paper, behind Eq. 9); W starts as given."""

    def __init__(self, temperature_scale: float = 100.0) -> None:
        super().__init__()
        self.classifier = OneShotClassifier(temperature_scale)

    def forward(self, queries: Tensor, support: Tensor, targets: Tensor, score: Score) -> Step:
        """See `EpisodeLoss`; ``parts`` tell the present W."""
        logits = self.classifier(queries, support, score)
        parts = {"W": self.classifier.weight.detach()}
        return Step(F.cross_entropy(logits, targets), _accuracy(logits, targets), parts)


class Triplet(EpisodeLoss):
    """[margin + d(query, own way) - d(query, other way)]₊ (paper, Sec. VI-D, "Loss").

    With ``mining='hardest'`` the other way is the one most like the query (the lazy form of
    PointNetVLAD, mikacuy/pointnetvlad), with 'all' the mean over all ways is taken.
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
        """Loss, a scalar, of the scores (q, ways) of queries of the ways ``targets`` (q,)."""
        other = ~F.one_hot(targets, scores.shape[1]).bool()
        violation = (self.margin + scores - _own(scores, targets)[:, None]).clamp_min(0)
        return _mined(violation, other, self.mining).mean()


class Quadruplet(EpisodeLoss):
    """The triplet loss, and [second_margin + d(query, own way) - d(way, another way)]₊ with it.

    Neither way of the second term is the query's own (mikacuy/pointnetvlad, whose margins are
    the defaults; DiSCO takes the same).
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
                f"sampling.ways: {ways}; the quadruplet loss needs two ways beside the query's "
                "own, so at least 3"
            )
        scores = class_scores(queries, support, score)
        first = self.triplet.of_scores(scores, targets)
        alike = class_scores(support.flatten(0, 1), support, score)  # (ways * shots, ways)
        alike = alike.view(ways, shots, ways).amax(dim=1)
        number = torch.arange(ways, device=alike.device)
        apart = number[:, None] < number[None, :]
        foreign = number[None] != targets[:, None]  # (q, ways)
        pairs = apart & foreign[:, :, None] & foreign[:, None, :]  # (q, ways, ways)
        own = _own(scores, targets)
        violation = (self.second_margin + alike - own[:, None, None]).clamp_min(0)
        second = _mined(violation.flatten(1), pairs.flatten(1), self.mining).mean()
        return Step(first + second, _accuracy(scores, targets), {})


def _accuracy(scores: Tensor, targets: Tensor) -> Tensor:
    return (scores.argmax(dim=-1) == targets).float().mean()


def _own(scores: Tensor, targets: Tensor) -> Tensor:
    return scores.gather(1, targets[:, None]).squeeze(1)


def _mined(violation: Tensor, counted: Tensor, mining: Mining) -> Tensor:
    """(q,) of violations (q, n), none negative, where ``counted``."""
    values = violation * counted
    return values.amax(dim=1) if mining == "hardest" else values.sum(dim=1) / counted.sum(dim=1)
