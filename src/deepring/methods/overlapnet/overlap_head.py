"""OverlapNet's overlap (delta) head: differences of all columns of two scans.

Source: Chen et al., RSS 2020 (PRBonn/OverlapNet).
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError

_KERNEL = 3

#: Of the first weights beside those of the diagonals, as a share of Glorot's.
_NOISE = 0.02


class OverlapHead(nn.Module):
    """The logit of the overlap of two scans from their columns, (n, columns, channels) each.

    The magnitudes of the differences of every column of the first and every one of the second are
    summarised in blocks of ``block`` columns of the second, without an activation, and then of the
    first; a convolution and a dense layer follow. The two sides are not treated alike.

    It starts with weights by which every difference of a column from the one at its own place
    makes an overlap smaller, so that an untrained network too finds a scan most like itself.
    """

    def __init__(self, columns: int, channels: int, block: int, widths: Sequence[int]) -> None:
        super().__init__()
        checks.count("overlapnet.block", block)
        if len(checks.widths("overlapnet.widths", widths)) != 3:
            raise ConfigError(f"overlapnet.widths: {list(widths)}, expected three numbers")
        side = columns // block - _KERNEL + 1
        if side < 1:
            raise ConfigError(
                f"overlapnet.block: {block}, expected at most a third of the {columns} columns"
            )
        first, second, third = widths
        self.across = nn.Conv2d(channels, first, (1, block), (1, block))
        self.along = nn.Conv2d(first, second, (block, 1), (block, 1))
        self.around = nn.Conv2d(second, third, _KERNEL)
        self.last = nn.Linear(third * side * side, 1)
        self._start(block, side)

    @torch.no_grad()
    def _start(self, block: int, side: int) -> None:
        """Summaries of each diagonal of a block, and those of the main one counted; some noise."""
        for layer in (self.across, self.along, self.around, self.last):
            nn.init.xavier_uniform_(layer.weight, gain=_NOISE)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
        first, channels = self.across.weight.shape[:2]
        column = torch.arange(first) % block
        self.across.weight[torch.arange(first), :, 0, column] += 1 / channels
        rows, second = torch.arange(block), len(self.along.weight)
        for offset in range(second):
            met = column == (rows[:, None] + offset) % block  # (block, first)
            share = met / met.sum(dim=1, keepdim=True).clamp_min(1) / block
            self.along.weight[offset, :, :, 0] += share.T.to(self.along.weight)
        third = len(self.around.weight)
        self.around.weight[torch.arange(third), torch.arange(third) % second, 1, 1] += 1
        main = [k for k in range(third) if k % second % block == 0]
        weights = self.last.weight.view(third, side, side)
        weights[main] -= torch.eye(side, device=weights.device) / (side * len(main))

    def forward(
        self, first: Float[Tensor, "n column value"], second: Float[Tensor, "n column value"]
    ) -> Float[Tensor, " n"]:
        """Logits (n,)."""
        down, across = first.transpose(1, 2)[..., :, None], second.transpose(1, 2)[..., None, :]
        differences = (down - across).abs()
        x = self.along(self.across(differences)).relu()
        x = self.around(x).relu()
        logits: Tensor = self.last(torch.flatten(x, 1))[:, 0]
        return logits
