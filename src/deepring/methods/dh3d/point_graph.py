"""Which points of a cloud are near which: made once for a cloud, used by all layers of DH3D."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring.nn.neighbourhoods import distances, farthest_points, gathered

#: Points that a coarse point spreads its features to take them from so many.
SOURCES = 3

#: Added to squared distances, as in `deepring.nn.neighbourhoods.interpolated`.
_LEAST = 1e-8

#: Rows of a matrix of distances in memory at once, on a GPU.
_ROWS = 2048


class PointGraph(NamedTuple):
    """b clouds of n points, of which m far apart make a coarse cloud."""

    points: Float[Tensor, "batch n 3"]
    """Metres."""
    near: Int64[Tensor, "batch n k"]
    """Numbers of the k nearest points of each point, itself among them."""
    chosen: Int64[Tensor, "batch m"]
    """Numbers of the coarse points among all."""
    coarse: Float[Tensor, "batch m 3"]
    """The coarse points, metres."""
    coarse_near: Int64[Tensor, "batch m k"]
    """Numbers of the k nearest coarse points of each."""
    sources: Int64[Tensor, "batch n 3"]
    """Numbers of the three coarse points nearest to each point."""
    shares: Float[Tensor, "batch n 3"]
    """Their inverse squared distances, of sum 1."""

    def coarsened(self, features: Float[Tensor, "batch n c"]) -> Float[Tensor, "batch m c"]:
        """The features of the coarse points."""
        return gathered(features, self.chosen)

    def spread(self, features: Float[Tensor, "batch m c"]) -> Float[Tensor, "batch n c"]:
        """Features of the coarse points, interpolated at all points."""
        values = gathered(features, self.sources.flatten(1))
        values = values.view(*self.sources.shape, features.shape[-1])
        return (self.shares[..., None] * values).sum(dim=2)


@torch.no_grad()
def point_graph(
    points: Float[Tensor, "batch n 3"], neighbours: int = 8, thinning: int = 8
) -> PointGraph:
    """The graph of clouds (b, n, 3), metres; every ``thinning``-th point is coarse."""
    near = nearest_numbers(points, points, neighbours)
    chosen = farthest_points(points, points.shape[1] // thinning)
    coarse = gathered(points, chosen)
    sources = nearest_numbers(points, coarse, SOURCES)
    from_there = gathered(coarse, sources.flatten(1)).view(*sources.shape, 3)
    inverse = 1.0 / ((from_there - points[:, :, None]).square().sum(dim=-1) + _LEAST)
    shares = inverse / inverse.sum(dim=-1, keepdim=True)
    coarse_near = nearest_numbers(coarse, coarse, neighbours)
    return PointGraph(points, near, chosen, coarse, coarse_near, sources, shares)


def nearest_numbers(
    centres: Float[Tensor, "batch m 3"], points: Float[Tensor, "batch n 3"], number: int
) -> Int64[Tensor, "batch m k"]:
    """Numbers of the ``number`` nearest points of each centre, nearest first.

    A tree on the CPU, and blocks of distances elsewhere; of points equally far any may come first.
    """
    if points.device.type == "cpu":
        from scipy.spatial import KDTree

        clouds = zip(centres.numpy(), points.numpy(), strict=True)
        found = [KDTree(cloud).query(c, k=[*range(1, number + 1)])[1] for c, cloud in clouds]
        shape = (len(found), centres.shape[1], number)
        return torch.from_numpy(np.reshape(np.array(found, dtype=np.int64), shape))
    blocks = [
        distances(rows, points).topk(number, dim=-1, largest=False).indices
        for rows in torch.split(centres, _ROWS, dim=1)
    ]
    return torch.cat(blocks, dim=1)
