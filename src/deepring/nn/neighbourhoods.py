"""Points of a cloud chosen far apart, those around a point, and features between points.

Source: Qi et al., PointNet++ (NeurIPS 2017), Sec. 3: farthest-point sampling, ball query and
interpolation by the three nearest. Used by networks on points, such as DH3D and LCDNet.
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring.checks import count, positive
from deepring.errors import DataError

#: Added to squared distances, so that a point at a source's place takes that source's features.
_LEAST = 1e-8


def farthest_points(points: Float[Tensor, "batch n 3"], number: int) -> Int64[Tensor, "batch m"]:
    """Numbers of ``number`` points, each the farthest from those before it, beginning with 0.

    Of equally far points the first is taken. Once all places are taken, points at places that are
    taken already follow, the first of them again and again.

    Args:
        points: (b, n, 3).
        number: m, at most n.

    Raises:
        DataError: fewer than ``number`` points.

    >>> farthest_points(torch.tensor([[[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [2, 0, 0]]]), 3)
    tensor([[0, 2, 3]])
    """
    count("number", number)
    batch, total = points.shape[:2]
    if total < number:
        raise DataError(f"points: {total} in a cloud, expected at least number={number}")
    chosen = torch.zeros(batch, number, dtype=torch.int64, device=points.device)
    nearest = torch.full((batch, total), torch.inf, dtype=points.dtype, device=points.device)
    for k in range(1, number):
        last = gathered(points, chosen[:, k - 1 : k])
        nearest = torch.minimum(nearest, (points - last).square().sum(dim=-1))
        chosen[:, k] = nearest.argmax(dim=1)
    return chosen


def ball_query(
    centres: Float[Tensor, "batch m 3"],
    points: Float[Tensor, "batch n 3"],
    radius: float,
    number: int,
) -> Int64[Tensor, "batch m k"]:
    """Numbers of the first ``number`` points at most ``radius`` from each centre, in their order.

    Where there are fewer, the first of them fills the rest; without any, the nearest point does.

    Args:
        centres: (b, m, 3).
        points: (b, n, 3), n at least 1.
        radius: in the unit of the points.
        number: k.

    Raises:
        DataError: no points.

    >>> points = torch.tensor([[[0.0, 0, 0], [9, 0, 0], [1, 0, 0]]])
    >>> ball_query(points[:, :2], points, radius=2.0, number=3)
    tensor([[[0, 2, 0],
             [1, 1, 1]]])
    """
    count("number", number)
    positive("radius", radius, "metres")
    total = _some(points)
    distance = distances(centres, points)
    inside = distance <= radius
    order = torch.arange(total, device=points.device)
    ranks = torch.where(inside, order, total)
    first = ranks.sort(dim=-1).values[..., :number]
    if first.shape[-1] < number:
        missing = number - first.shape[-1]
        first = torch.nn.functional.pad(first, (0, missing), value=total)
    nearest = distance.argmin(dim=-1, keepdim=True)
    fill = torch.where(first[..., :1] < total, first[..., :1], nearest)
    return torch.where(first < total, first, fill)


def nearest_points(
    centres: Float[Tensor, "batch m 3"], points: Float[Tensor, "batch n 3"], number: int
) -> Int64[Tensor, "batch m k"]:
    """Numbers of the ``number`` nearest points of each centre, nearest first; of equals the first.

    Raises DataError for fewer points than that.
    """
    count("number", number)
    total = _some(points)
    if total < number:
        raise DataError(f"points: {total} in a cloud, expected at least number={number}")
    return distances(centres, points).sort(dim=-1, stable=True).indices[..., :number]


def interpolated(
    features: Float[Tensor, "batch n channel"],
    points: Float[Tensor, "batch n 3"],
    centres: Float[Tensor, "batch m 3"],
) -> Float[Tensor, "batch m channel"]:
    """Features (b, m, c) at the centres, from those (b, n, c) of their three nearest points.

    Weights are the inverse squared distances, of sum 1; all points count where there are fewer
    than three. A centre at a point's place has its features.

    Raises DataError for no points.
    """
    total = _some(points)
    number = min(3, total)
    chosen = nearest_points(centres, points, number)
    near = gathered(points, chosen.flatten(1)).view(*chosen.shape, 3)
    weights = 1.0 / ((near - centres[:, :, None]).square().sum(dim=-1) + _LEAST)
    weights = weights / weights.sum(dim=-1, keepdim=True)
    values = gathered(features, chosen.flatten(1)).view(*chosen.shape, features.shape[-1])
    return (weights[..., None] * values).sum(dim=2)


def gathered(
    rows: Float[Tensor, "batch n channel"], numbers: Int64[Tensor, "batch m"]
) -> Float[Tensor, "batch m channel"]:
    """The rows of these numbers, (b, m, c)."""
    return rows.gather(1, numbers[..., None].expand(-1, -1, rows.shape[-1]))


def distances(
    centres: Float[Tensor, "batch m 3"], points: Float[Tensor, "batch n 3"]
) -> Float[Tensor, "batch m n"]:
    """Distances (b, m, n), without matrix products, whose cancellation confuses close points."""
    return torch.cdist(centres, points, compute_mode="donot_use_mm_for_euclid_dist")


def _some(points: Float[Tensor, "batch n 3"]) -> int:
    """The number of points of a cloud. Raises DataError for none."""
    total = points.shape[1]
    if not total:
        raise DataError("points: 0 in a cloud, expected at least 1")
    return total
