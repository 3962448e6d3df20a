"""Losses of an episode: cross-entropy, and the triplet and quadruplet losses it is compared with.

All see an episode in the same way: how alike each query and each way are under the method's own
similarity. For L2 that is the negative distance, so that a difference of scores is a difference
of distances and the margins are those of the literature.
"""

from typing import Literal, NamedTuple, get_args

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring.errors import DeepringError
from deepring.training.classifier import OneShotClassifier, Score, class_scores

Mining = Literal["hardest", "all"]
"""Which wrong ways count: the most alike one, or the mean over all."""


class EpisodeLoss(NamedTuple):
    """What a loss makes of an episode."""

    loss: Tensor
    """Scalar, to be minimised."""
    scores: Tensor
    """(q, ways); the largest is the way that the query is taken for."""


class OneShotCrossEntropy(nn.Module):
    """Cross-entropy of the one-shot classifier (paper, Eq. 9 and 10); W starts as given."""

    def __init__(self, temperature_scale: float = 100.0) -> None:
        super().__init__()
        self.classifier = OneShotClassifier(temperature_scale)

    def forward(
        self, queries: Tensor, support: Tensor, targets: Tensor, score: Score
    ) -> EpisodeLoss:
        """Of descriptors (q, ...), support (ways, shots, ...) and the queries' ways (q,)."""
        logits = self.classifier(queries, support, score)
        return EpisodeLoss(F.cross_entropy(logits, targets), logits)


class Triplet(nn.Module):
    """[margin + d(query, own way) - d(query, other way)]₊ (paper, Sec. VI-D, "Loss").

    With ``mining='hardest'`` the other way is the one most like the query (the lazy form of
    PointNetVLAD, mikacuy/pointnetvlad), with 'all' the mean over all ways is taken.
    """

    def __init__(self, margin: float = 0.5, mining: Mining = "hardest") -> None:
        super().__init__()
        self.margin = _positive("loss.margin", margin)
        self.mining = expect_mining("loss.mining", mining)

    def forward(
        self, queries: Tensor, support: Tensor, targets: Tensor, score: Score
    ) -> EpisodeLoss:
        """Of descriptors (q, ...), support (ways, shots, ...) and the queries' ways (q,)."""
        scores = class_scores(queries, support, score)
        own = _own(scores, targets)
        other = ~F.one_hot(targets, scores.shape[1]).bool()
        violation = (self.margin + scores - own[:, None]).clamp_min(0)
        return EpisodeLoss(_mined(violation, other, self.mining).mean(), scores)


class Quadruplet(nn.Module):
    """The triplet loss, and [second_margin + d(query, own way) - d(way, another way)]₊ with it.

    Neither way of the second term is the query's own (mikacuy/pointnetvlad, whose margins are
    the defaults; DiSCO takes the same).
    """

    def __init__(
        self, margin: float = 0.5, second_margin: float = 0.2, mining: Mining = "hardest"
    ) -> None:
        super().__init__()
        self.triplet = Triplet(margin, mining)
        self.second_margin = _positive("loss.second_margin", second_margin)
        self.mining = mining

    def forward(
        self, queries: Tensor, support: Tensor, targets: Tensor, score: Score
    ) -> EpisodeLoss:
        """Of descriptors (q, ...), support (ways, shots, ...) and the queries' ways (q,)."""
        first = self.triplet(queries, support, targets, score)
        ways, shots = support.shape[:2]
        if ways < 3:
            raise DeepringError(
                f"episode.ways: {ways}; the quadruplet loss needs two ways beside the query's "
                "own, so at least 3"
            )
        alike = class_scores(support.flatten(0, 1), support, score)  # (ways * shots, ways)
        alike = alike.view(ways, shots, ways).amax(dim=1)
        number = torch.arange(ways, device=alike.device)
        apart = number[:, None] < number[None, :]
        foreign = number[None] != targets[:, None]  # (q, ways)
        pairs = apart & foreign[:, :, None] & foreign[:, None, :]  # (q, ways, ways)
        own = _own(first.scores, targets)
        violation = (self.second_margin + alike - own[:, None, None]).clamp_min(0)
        second = _mined(violation.flatten(1), pairs.flatten(1), self.mining).mean()
        return EpisodeLoss(first.loss + second, first.scores)


def _own(scores: Tensor, targets: Tensor) -> Tensor:
    return scores.gather(1, targets[:, None]).squeeze(1)


def _mined(violation: Tensor, chosen: Tensor, mining: Mining) -> Tensor:
    """(q,) of violations (q, n), none negative, where ``chosen``."""
    kept = violation * chosen
    return kept.amax(dim=1) if mining == "hardest" else kept.sum(dim=1) / chosen.sum(dim=1)


def _positive(name: str, value: float) -> float:
    if not value > 0:
        raise DeepringError(f"{name}: {value}, expected more than 0")
    return value


def expect_mining(name: str, mining: Mining) -> Mining:
    """Raise DeepringError where ``mining`` is no `Mining`."""
    if mining not in get_args(Mining):
        raise DeepringError(f"{name}: {mining!r}, expected 'hardest' or 'all'")
    return mining
