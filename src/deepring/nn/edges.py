"""Convolutions over each point's nearest neighbours, in the space of its features or its own.

Source: Wang et al., Dynamic Graph CNN (ACM TOG 2019), Sec. 3, as LPD-Net uses it (Liu et al.,
ICCV 2019). Points are the first axis after the batch, (b, n, channels), so that a neighbour is one
row.
"""

from collections.abc import Sequence
from itertools import pairwise

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from deepring.checks import count
from deepring.errors import DataError


def nearest_rows(x: Float[Tensor, "batch n channel"], number: int) -> Int64[Tensor, "batch n k"]:
    """Numbers of the ``number`` rows nearest to each row, itself among them, in no certain order.

    Which of equally far rows is taken is open. Unlike `deepring.nn.neighbourhoods.nearest_points`
    it multiplies matrices, one cloud at a time: for many channels it is much the faster, and a
    cloud's neighbours do not depend on the batch. Rows are centred first, so that distances are
    right to some 1e-7 of the cloud's squared radius.

    Raises DataError for fewer rows than that.
    """
    count("number", number)
    total = x.shape[1]
    if total < number:
        raise DataError(f"x: {total} points in a cloud, expected at least number={number}")
    found = torch.empty(*x.shape[:2], number, dtype=torch.int64, device=x.device)
    for rows, numbers in zip(x.detach(), found, strict=True):
        centred = rows - rows.mean(dim=0)
        # |a - b|² less |a|², which is the same for a whole row.
        away = centred.square().sum(dim=1) - 2 * centred @ centred.T
        numbers.copy_(away.topk(number, dim=1, largest=False, sorted=False).indices)
    return found


class NeighbourConv(nn.Module):
    """The largest of a network's outputs over a point's neighbours: (b, n, in) -> (b, n, out).

    The network takes the neighbours' features x_j; with ``edges`` the point's own and the way to
    its neighbour, [x_i, x_j - x_i], which is EdgeConv. Each layer is linear, batch norm, ReLU.

    The first layer is applied to points and then gathered, W_1 x_i + W_2 (x_j - x_i) =
    (W_1 - W_2) x_i + W_2 x_j, which is the same and k times cheaper.
    """

    def __init__(self, in_channels: int, widths: Sequence[int], *, edges: bool) -> None:
        super().__init__()
        self.edges = edges
        self.first = nn.Linear(in_channels * (1 + edges), widths[0], bias=False)
        self.first_norm = nn.BatchNorm1d(widths[0])
        layers: list[nn.Module] = [nn.ReLU(inplace=True)]
        for source, width in pairwise(widths):
            layers += [
                nn.Linear(source, width, bias=False),
                nn.BatchNorm1d(width),
                nn.ReLU(inplace=True),
            ]
        self.rest = nn.Sequential(*layers)

    def forward(
        self, x: Float[Tensor, "batch n in"], near: Int64[Tensor, "batch n k"]
    ) -> Float[Tensor, "batch n out"]:
        """Features of points (b, n, in) whose neighbours are the numbers ``near`` (b, n, k)."""
        batch, n, k = near.shape
        offset = torch.arange(batch, device=near.device)[:, None] * n
        rows, numbers = x.flatten(0, 1), (near.flatten(1) + offset).flatten()
        if self.edges:
            own, way = self.first.weight.chunk(2, dim=1)
            others = (rows @ way.T).index_select(0, numbers).view(batch * n, k, len(way))
            edges = (others + (rows @ (own - way).T)[:, None]).flatten(0, 1)
        else:
            edges = self.first(rows).index_select(0, numbers)
        features = self.rest(self.first_norm(edges))
        return features.view(batch, n, k, features.shape[-1]).amax(dim=2)
