"""LCDNet's pose head: keypoints matched by unbalanced transport, and the transform they say.

Source: Cattaneo, Vaghi, Valada, T-RO 2022, Sec. III-C; the transport with learned ε and γ is that
of Puy et al., "FLOT", ECCV 2020.
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError
from deepring.nn.rigid_fit import rigid_fit

#: ε is above this.
_LEAST_EPSILON = 0.03


class Matches(NamedTuple):
    """Where a network sees the points of one cloud in another."""

    points: Float[Tensor, "batch n 3"]
    """The keypoints of the first cloud, metres."""
    matched: Float[Tensor, "batch n 3"]
    """The mean of the second cloud's keypoints that each is matched with."""
    weights: Float[Tensor, "batch n"]
    """How much of each is matched."""
    transforms: Float[Tensor, "batch 4 4"]
    """float64, carry the first cloud's points onto the second's."""
    told: Bool[Tensor, " batch"]
    """Whether the matches tell a transform."""


def unbalanced_transport(
    cost: Float[Tensor, "batch n m"],
    epsilon: float | Float[Tensor, ""],
    gamma: float | Float[Tensor, ""],
    iterations: int = 5,
) -> Float[Tensor, "batch n m"]:
    """T (b, n, m): how much of each of n points goes to each of m, by Sinkhorn's iterations.

    T = a K b, K = exp(-C / ε), with b ← (1/m / Kᵀa)^power and a ← (1/n / Kb)^power in turn, power
    γ / (γ + ε). As γ → ∞ each point sends 1/n and receives 1/m; with a small γ those that find
    nothing alike send less than others. Gradients reach ε and γ.
    """
    n, m = cost.shape[1:]
    kernel = torch.exp(-cost / epsilon)
    power = gamma / (gamma + epsilon)
    a = torch.full_like(cost[:, :, :1], 1 / n)
    b = torch.full_like(cost[:, :1], 1 / m)
    tiny = torch.finfo(cost.dtype).tiny
    for _ in range(iterations):
        b = ((1 / m) / (kernel * a).sum(dim=1, keepdim=True).clamp_min(tiny)) ** power
        a = ((1 / n) / (kernel * b).sum(dim=2, keepdim=True).clamp_min(tiny)) ** power
    return a * kernel * b


class PoseHead(nn.Module):
    """Features of the keypoints of two clouds -> the transform from one to the other.

    Learns ε and γ alone, from ``epsilon`` and 1.
    """

    def __init__(self, epsilon: float = 1.03, iterations: int = 5) -> None:
        super().__init__()
        self.iterations = checks.count("lcdnet.iterations", iterations)
        least = checks.at_least("lcdnet.epsilon", epsilon, 0)
        if least <= _LEAST_EPSILON:
            raise ConfigError(f"lcdnet.epsilon: {epsilon:g}, expected above {_LEAST_EPSILON:g}")
        self.log_epsilon = nn.Parameter(torch.tensor(math.log(epsilon - _LEAST_EPSILON)))
        self.log_gamma = nn.Parameter(torch.zeros(()))

    @property
    def epsilon(self) -> Tensor:
        """ε, above 0.03."""
        return self.log_epsilon.exp() + _LEAST_EPSILON

    @property
    def gamma(self) -> Tensor:
        """γ, above 0."""
        return self.log_gamma.exp()

    def forward(
        self,
        points: Float[Tensor, "batch n 3"],
        features: Float[Tensor, "batch n channel"],
        other_points: Float[Tensor, "batch m 3"],
        other_features: Float[Tensor, "batch m channel"],
    ) -> Matches:
        """Match points (b, n, 3) with those of other clouds (b, m, 3)."""
        with torch.autocast(points.device.type, enabled=False):
            first, second = (F.normalize(f.float(), dim=-1) for f in (features, other_features))
            cost = 1 - first @ second.transpose(1, 2)
            transport = unbalanced_transport(cost, self.epsilon, self.gamma, self.iterations)
            weights = transport.sum(dim=2)
            share = transport / weights.clamp_min(torch.finfo(weights.dtype).tiny)[:, :, None]
            matched = share @ other_points.float()
            transforms, told = rigid_fit(points, matched, weights)
        return Matches(points, matched, weights, transforms, told)
