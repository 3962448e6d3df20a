"""The points of a batch of clouds around given centres, searched along x.

`deepring.nn.neighbourhoods` compares every centre with every point, which 4096 centres and 40 000
points are too many for.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring.checks import count, positive
from deepring.errors import DataError


def rows_in_balls(
    centres: Float[Tensor, "batch m 3"],
    points: Float[Tensor, "n 3"],
    counts: Sequence[int],
    radius: float,
    number: int,
) -> Int64[Tensor, "batch m k"]:
    """Rows of ``number`` points at most ``radius`` from each centre; -1 where there are none.

    They are spread evenly over those in the ball, in the order of x and then of the rows: row
    ⌊j c / k⌋ of c for each j below k. So the sample covers the ball, and where there are fewer
    than k each comes as often as the others. PointNet++ takes the first k instead, which depends
    on how the points are sorted.

    Args:
        centres: (b, m, 3).
        points: (n, 3) of all clouds, one after the other.
        counts: number of points of each of the b clouds.
        radius: in the unit of the points.
        number: k.

    Raises:
        DataError: another number of clouds or points than ``counts`` says.

    >>> centres = torch.tensor([[[0.0, 0, 0], [9, 0, 0]]])
    >>> points = torch.tensor([[0.0, 0, 1], [-1, 0, 0], [1, 0, 0], [3, 0, 0]])
    >>> rows_in_balls(centres, points, [4], radius=1.0, number=2)
    tensor([[[ 1,  0],
             [-1, -1]]])
    """
    from deepring.nn import _ball_kernels as _kernels

    count("number", number)
    positive("radius", radius, "metres")
    if len(counts) != len(centres) or sum(counts) != len(points):
        raise DataError(
            f"counts: {len(counts)} clouds of {sum(counts)} points, expected {len(centres)} of "
            f"{len(points)}"
        )
    cloud = np.ascontiguousarray(points.detach().cpu().numpy(), dtype=np.float32)
    middles = np.ascontiguousarray(centres.detach().cpu().numpy(), dtype=np.float32)
    rows = np.empty((*centres.shape[:2], number), dtype=np.int64)
    start = 0
    for of_cloud, size, chosen in zip(middles, counts, rows, strict=True):
        part = cloud[start : start + size]
        order = np.argsort(part[:, 0], kind="stable")
        _kernels.spread_in_balls(of_cloud, part, order, np.float32(radius), chosen)
        chosen[chosen >= 0] += start
        start += size
    return torch.from_numpy(rows).to(points.device)
