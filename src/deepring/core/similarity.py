"""Similarities without the search over rotations of Eq. 8: distance, cosine (paper, Sec. VI-D)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32
from torch import Tensor


def negative_distance(
    queries: Float[Tensor, " q *descriptor"], database: Float[Tensor, " d *descriptor"]
) -> Float32[Tensor, "q d"]:
    """-‖Q - D‖ for all pairs: (q, ...) and (d, ...) -> (q, d) float32, at most 0.

    Differences are squared directly: the expansion into products would lose four digits for
    descriptors of unit norm that are close together.

    >>> import torch
    >>> negative_distance(torch.tensor([[3.0, 4.0]]), torch.zeros(2, 2))
    tensor([[-5., -5.]])
    """
    q, d = queries.flatten(1).float(), database.flatten(1).float()
    return -torch.cdist(q, d, compute_mode="donot_use_mm_for_euclid_dist")


def cosine(
    queries: Float[Tensor, " q *descriptor"], database: Float[Tensor, " d *descriptor"]
) -> Float32[Tensor, "q d"]:
    """Cosine of the angle between all pairs: (q, ...) and (d, ...) -> (q, d), in [-1, 1].

    >>> import torch
    >>> cosine(torch.tensor([[2.0, 0.0]]), torch.tensor([[1.0, 0.0], [0.0, 5.0]]))
    tensor([[1., 0.]])
    """
    q = F.normalize(queries.flatten(1).float(), dim=1)
    d = F.normalize(database.flatten(1).float(), dim=1)
    return q @ d.T
