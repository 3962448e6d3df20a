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


class OverlapHead(nn.Module):
    """The logit of the overlap of two scans from their columns, (n, columns, channels) each.

    The magnitudes of the differences of every column of the first and every one of the second are
    summarised in blocks of ``block`` columns of the second, without an activation, and then of the
    first; a convolution and a dense layer follow. The two sides are not treated alike.
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
