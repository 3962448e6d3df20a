"""RINet's layers: convolutions and subsampling along θ that no turn disturbs.

Source: Li et al., RA-L 2022 (lilin-hitcrt/RINet). Subsampling is adaptive polyphase sampling
(Chaman and Dokmanić, "Truly shift-invariant convolutional neural networks", CVPR 2021).
"""

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

#: Slope of the leaky ReLU below 0.
SLOPE = 0.1

_KERNEL = 3


class CircularConv1d(nn.Module):
    """Convolution over θ that goes on from the end to the start, normalised, with a leaky ReLU.

    Column k sees columns k, k + 1 and k + 2: it is padded at the right alone, as published.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = nn.Conv1d(inputs, outputs, _KERNEL)
        self.norm = nn.BatchNorm1d(outputs)

    def forward(self, x: Float[Tensor, "batch channel theta"]) -> Float[Tensor, "batch out theta"]:
        """(b, inputs, θ) -> (b, outputs, θ)."""
        wrapped = torch.cat([x, x[..., : _KERNEL - 1]], dim=-1)
        return F.leaky_relu(self.norm(self.conv(wrapped)), SLOPE)


class ChannelGate(nn.Module):
    """Each channel times a weight in (0, 1), which depends on the mean of all channels over θ."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(channels, channels)

    def forward(
        self, x: Float[Tensor, "batch channel theta"]
    ) -> Float[Tensor, "batch channel theta"]:
        """(b, channels, θ), weighted."""
        weights = torch.sigmoid(self.linear(x.mean(dim=-1)))
        return x * weights[..., None]


def strongest_phase(
    x: Float[Tensor, "batch channel theta"], step: int
) -> Float[Tensor, "batch channel theta/{step}"]:
    """Every ``step``-th column, from that of the first ``step`` whose columns are largest in L1.

    A roll of x by any number of columns rolls the result by whole columns. Of equal ones the first
    counts, and then it may not.

    >>> import torch
    >>> x = torch.tensor([[[1.0, 0, 2, 0, 3, 0], [0, 1, 0, -6, 0, 0]]])
    >>> strongest_phase(x, 2)
    tensor([[[ 0.,  0.,  0.],
             [ 1., -6.,  0.]]])
    """
    phases = x.reshape(*x.shape[:-1], x.shape[-1] // step, step)  # (b, c, θ / step, step)
    # In double precision, so that rounding does not choose between phases.
    norms = phases.detach().double().abs().sum(dim=(1, 2))
    best = norms.argmax(dim=-1)[:, None, None, None].expand(-1, *phases.shape[1:3], 1)
    return phases.gather(-1, best)[..., 0]


class Describer(nn.Module):
    """(b, channels, θ) -> the means over θ of every stage, one after the other.

    A first convolution keeps the channels; then each stage is a convolution, after a subsampling
    but for the first. Gates stand before the first convolution and after each.
    """

    def __init__(
        self, channels: int, widths: Sequence[int], steps: Sequence[int], gates: bool
    ) -> None:
        super().__init__()
        self.steps = (1, *steps)

        def gate(width: int) -> nn.Module:
            return ChannelGate(width) if gates else nn.Identity()

        self.first = nn.Sequential(gate(channels), CircularConv1d(channels, channels))
        self.between = gate(channels)
        before = (channels, *widths[:-1])
        self.stages = nn.ModuleList(
            nn.Sequential(CircularConv1d(inputs, outputs), gate(outputs))
            for inputs, outputs in zip(before, widths, strict=True)
        )

    def forward(self, x: Float[Tensor, "batch channel theta"]) -> Float[Tensor, "batch value"]:
        """Means (b, sum of the widths)."""
        x, means = self.between(self.first(x)), []
        for step, stage in zip(self.steps, self.stages, strict=True):
            x = stage(strongest_phase(x, step) if step > 1 else x)
            means.append(x.mean(dim=-1))
        return torch.cat(means, dim=-1)


class MatchHead(nn.Module):
    """The logit that two descriptors are of one place, from the magnitudes of their differences.

    It starts with weights by which every difference makes a match less likely, so that an
    untrained network too finds a scan most like itself.
    """

    def __init__(self, size: int, hidden: int) -> None:
        super().__init__()
        self.hidden = nn.Linear(size, hidden)
        self.last = nn.Linear(hidden, 1)
        with torch.no_grad():
            self.hidden.weight.abs_()
            self.last.weight.abs_().neg_()

    def forward(
        self, first: Float[Tensor, "*#pairs value"], second: Float[Tensor, "*#pairs value"]
    ) -> Float[Tensor, " *_"]:
        """Logits (...) of descriptors (..., size), which are spread over each other."""
        features = F.leaky_relu(self.hidden((first - second).abs()), SLOPE)
        logits: Tensor = self.last(features)[..., 0]
        return logits
