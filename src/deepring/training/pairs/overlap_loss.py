"""The loss of overlaps and turns of pairs of scans (OverlapNet: Chen et al., RSS 2020)."""

from typing import NamedTuple, Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring import checks
from deepring.training.scheme import Step

#: Slope and shift of the published loss of an overlap's error.
_SLOPE, _BESIDE, _MIDDLE = 24.0, 0.25, 12.0

#: Overlap from which the paper takes two scans for one place.
_LOOP = 0.3


@runtime_checkable
class OverlapHeads(Protocol):
    """A method that tells the overlap of two scans, and how alike they are at each turn."""

    def overlap_logits(self, first: Tensor, second: Tensor) -> Tensor:
        """Logits (n,) of the overlap of ``first[k]`` and ``second[k]``, descriptors (n, ...)."""
        ...

    def turn_curves(self, first: Tensor, second: Tensor) -> Tensor:
        """(n, s): how alike they are at turns of 0, 1, ... s-ths from ``second`` to ``first``."""
        ...


class OverlapPairs(NamedTuple):
    """n pairs of scans as a method tells them, and as they are."""

    logits: Tensor
    """(n,) of the overlap told."""
    curves: Tensor
    """(n, s), see `OverlapHeads`."""
    overlap: Tensor
    """(n,) float32 in [0, 1]."""
    turn: Tensor
    """(n,) float32 radians, of the points from the second scan to the first."""


class OverlapAndTurn(nn.Module):
    """5 · mean σ(24 (|Δ| + ¼) - 12), Δ the error of the overlap, and the cross-entropy of turns.

    The second term is the mean binary cross-entropy of each value of a curve, as a logit, with the
    one value that is the true turn; that one counts as often as all others together. It is taken
    over pairs that overlap by more than ``turn_from``, times ``turn``. With ``centred``, which is
    ours, each curve is taken without its mean, which changes no turn.

    `Step.accuracy` is the share of pairs that are told on the right side of an overlap of 0.3.

    Args:
        overlap: weight of the overlap's error
        turn: weight of the turn's cross-entropy
        turn_from: overlap from which on a pair tells a turn, in [0, 1]
        centred: whether curves are taken without their means
    """

    def __init__(
        self,
        overlap: float = 5.0,
        turn: float = 1.0,
        turn_from: float = 0.7,
        centred: bool = False,
    ) -> None:
        super().__init__()
        self.overlap = checks.at_least("loss.overlap", overlap, 0)
        self.turn = checks.at_least("loss.turn", turn, 0)
        self.turn_from = checks.share("loss.turn_from", turn_from)
        self.centred = checks.of_type("loss.centred", centred, bool)

    def forward(self, pairs: OverlapPairs) -> Step:
        """Loss of a batch; ``parts`` has both terms and the mean error of the overlap."""
        told = torch.sigmoid(pairs.logits)
        error = (told - pairs.overlap).abs()
        overlap = self.overlap * overlap_losses(error).mean()
        turn = self.turn * self._turn_loss(pairs)
        right = (told > _LOOP) == (pairs.overlap > _LOOP)
        parts = {"overlap": overlap, "turn": turn, "error": error.mean()}
        parts = {name: value.detach() for name, value in parts.items()}
        return Step(overlap + turn, right.float().mean(), parts)

    def _turn_loss(self, pairs: OverlapPairs) -> Tensor:
        counted = pairs.overlap > self.turn_from
        if not bool(counted.any()):
            return pairs.logits.new_zeros(())
        curves = pairs.curves[counted]
        if self.centred:
            curves = curves - curves.mean(dim=-1, keepdim=True)
        bins = turn_bins(pairs.turn[counted], curves.shape[-1])
        target = F.one_hot(bins, curves.shape[-1]).to(curves.dtype)
        often = curves.new_tensor(float(curves.shape[-1]))
        return F.binary_cross_entropy_with_logits(curves, target, pos_weight=often)


def overlap_losses(error: Tensor) -> Tensor:
    """σ(24 (|Δ| + ¼) - 12) of errors of the overlap.

    >>> (5 * overlap_losses(torch.tensor([0.0, 0.1, 0.25, 0.5]))).numpy().round(4).tolist()
    [0.012400000356137753, 0.13300000131130219, 2.5, 4.987599849700928]
    """
    return torch.sigmoid(_SLOPE * (error.abs() + _BESIDE) - _MIDDLE)


def turn_bins(turns: Tensor, bins: int) -> Tensor:
    """The nearest of so many turns, int64, counted counter-clockwise from 0.

    >>> turn_bins(torch.tensor([0.0, 1.6, -1.6]), 4)
    tensor([0, 1, 3])
    """
    return torch.round(turns * (bins / (2 * torch.pi))).long() % bins
