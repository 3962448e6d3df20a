"""The one-shot classifier: softmax(W C + b) over the ways (paper, Eq. 9)."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from deepring.core.correlation import circular_cross_correlation

Score = Callable[[Tensor, Tensor], Tensor]
"""How alike descriptors (q, ...) and (d, ...) are, (q, d); higher is more alike."""


def correlation(queries: Tensor, database: Tensor) -> Tensor:
    """Circular cross-correlation at the best rotation (paper, Eq. 8)."""
    return circular_cross_correlation(queries, database).score


def class_scores(queries: Tensor, support: Tensor, score: Score = correlation) -> Tensor:
    """How alike each of q queries and each way are, (q, ways), of support (ways, shots, ...).

    A class of several shots is as alike as its most alike shot, as in retrieval.
    """
    ways, shots = support.shape[:2]
    return score(queries, support.flatten(0, 1)).view(len(queries), ways, shots).amax(dim=-1)


class OneShotClassifier(nn.Module):
    """Logits W C + b of the correlations, two learned numbers.

    b is kept for the paper's sake: it cancels in the softmax and has no gradient. W is the
    inverse of a temperature; at the paper's learning rate it hardly moves from its start, so
    the start is a hyperparameter (100 for descriptors of unit norm).
    """

    def __init__(self, temperature_scale: float = 100.0) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.tensor(float(temperature_scale)))
        self.bias = nn.Parameter(torch.zeros(()))

    def forward(self, queries: Tensor, support: Tensor, score: Score = correlation) -> Tensor:
        """Logits (q, ways) of descriptors (q, θ, ω) against support (ways, shots, θ, ω)."""
        return self.weight * class_scores(queries, support, score) + self.bias
