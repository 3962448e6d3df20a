"""Keys that choose which scans are worth aligning; SSC as published has none."""

import torch
from jaxtyping import Float
from torch import Tensor

from deepring.methods.ssc.ssc_pairs import PairSettings
from deepring.rasters.classes import CLASSES

#: Bands of distance in which classes are counted.
BANDS = 10


def label_keys(
    points: Float[Tensor, "n point xyc"], settings: PairSettings
) -> Float[Tensor, "n key"]:
    """Roots of the shares of points by class and band of distance: (n, 200), of unit length.

    No turn of a scan changes them. A scan without points has zeros.
    """
    x, y, classes = points[:, settings.sectors :].unbind(dim=-1)
    band = (torch.hypot(x, y) * (BANDS / settings.radius)).long().clamp(max=BANDS - 1)
    counts = torch.zeros(len(points), len(CLASSES) * BANDS)
    counts.scatter_add_(1, classes.long() * BANDS + band, (classes > 0).float())
    return (counts / counts.sum(dim=1, keepdim=True).clamp_min(1.0)).sqrt()


def key_distances(
    queries: Float[Tensor, "q key"], places: Float[Tensor, "d key"]
) -> Float[Tensor, "q d"]:
    """L2 of keys, the Hellinger distance of the shares but for a factor."""
    return torch.cdist(queries, places, compute_mode="donot_use_mm_for_euclid_dist")
