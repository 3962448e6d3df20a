"""The triplets of a batch of scans that count, and whether its places are told apart."""

from typing import Literal

import torch
from torch import Tensor

TripletMining = Literal["hardest", "semihard", "all"]
"""The triplets of a batch that count, see `BatchHardTriplet`."""


def squared_distances(vectors: Tensor) -> Tensor:
    """(b, b) squared Euclidean distances of vectors (b, d)."""
    return (vectors[:, None] - vectors[None]).square().sum(dim=-1)


def batch_accuracy(distance: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    """Share of scans, detached, whose farthest positive is nearer than all their negatives.

    Scans without a positive or a negative do not count; 0 where none has both.
    """
    positive, negative = _extremes(distance, positives, negatives)
    right = (positive < negative).float()
    return (right.mean() if len(right) else distance.new_zeros(())).detach()


def _extremes(distance: Tensor, positives: Tensor, negatives: Tensor) -> tuple[Tensor, Tensor]:
    """Distances of the farthest positive and the nearest negative of each scan that has both."""
    usable = positives.any(dim=1) & negatives.any(dim=1)
    positive = distance.masked_fill(~positives, -torch.inf).amax(dim=1)[usable]
    negative = distance.masked_fill(~negatives, torch.inf).amin(dim=1)[usable]
    return positive, negative


def _hardest(distance: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    positive, negative = _extremes(distance, positives, negatives)
    return positive - negative


def _semihard(distance: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    scan, partner = (positives & negatives.any(dim=1, keepdim=True)).nonzero(as_tuple=True)
    own = distance[scan, partner]
    rows, other = distance[scan], negatives[scan]
    beyond = rows.masked_fill(~(other & (rows > own[:, None])), torch.inf).amin(dim=1)
    farthest = rows.masked_fill(~other, -torch.inf).amax(dim=1)
    return own - torch.where(beyond.isinf(), farthest, beyond)


def _all(distance: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    triplets = positives[:, :, None] & negatives[:, None, :]
    return (distance[:, :, None] - distance[:, None, :])[triplets]


TRIPLETS = {"hardest": _hardest, "semihard": _semihard, "all": _all}
"""d(a, p) - d(a, n) of the chosen triplets, (t,)."""
