"""Features of segments become one descriptor of a scan (Locus, Vidanapathirana et al. 2021)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

#: By how much a neighbour's weight falls with each metre, or with each unit of a feature.
RATE = 0.1


def pooled_neighbours(
    features: Float[Tensor, "b s feature"],
    distances: Float[Tensor, "b s s"],
    neighbours: int = 5,
) -> Float[Tensor, "b s feature"]:
    """What stands around each segment: the weighted features of its nearest neighbours.

    Weights are the softmax of -0.1 d over the ``neighbours`` nearest, d metres between two hulls.
    Infinite distances are those of no neighbour; a segment that stands alone has zeros.
    """
    s = features.shape[1]
    diagonal = torch.eye(s, dtype=torch.bool, device=features.device)
    others = distances.masked_fill(diagonal, torch.inf)
    # A stable order: of equally near ones the first rows count.
    nearest, place = others.sort(dim=-1, stable=True)
    nearest, place = nearest[..., :neighbours], place[..., :neighbours]
    weights = nearest_weights(nearest)
    spread = torch.zeros_like(others).scatter(-1, place, weights)
    return spread @ features


def nearest_weights(distances: Float[Tensor, "*rows k"]) -> Float[Tensor, "*rows k"]:
    """The softmax of -0.1 d along the last axis; infinite distances have no weight, and rows of
    them zeros.

    >>> nearest_weights(torch.tensor([2.0, 5.0, 10.0, torch.inf])).round(decimals=4)
    tensor([0.4566, 0.3383, 0.2052, 0.0000])
    """
    return torch.softmax(-RATE * distances, dim=-1).nan_to_num(0.0)


def second_order(
    features: Float[Tensor, "b s n"], pooled: Float[Tensor, "b s n"]
) -> Float[Tensor, "b n n"]:
    """The largest of each entry of the outer products f gᵀ over the segments, and of 0; float64.

    Rows of zeros, where there is no segment, take no part.
    """
    b, _, n = features.shape
    largest = features.new_zeros(b, n, n, dtype=torch.float64)
    # Segment by segment, since all products of a batch at once take much memory. In float64 one
    # segment's product has one singular value, and no others that are rounding alone.
    for f, g in zip(features.double().unbind(1), pooled.double().unbind(1), strict=True):
        largest = torch.maximum(largest, f[:, :, None] * g[:, None, :])
    return largest


def power_normalised(
    matrices: Float[Tensor, "b n n"], exponent: float = 0.5
) -> Float[Tensor, "b n n"]:
    """U diag(σ^exponent) Vᵀ of matrices U diag(σ) Vᵀ: powers of singular values, not of entries.

    >>> power_normalised(torch.tensor([[[2.0, 1.0], [1.0, 2.0]]]))[0].round(decimals=4)
    tensor([[1.3660, 0.3660],
            [0.3660, 1.3660]])
    """
    if not len(matrices):
        return matrices
    u, values, v = torch.linalg.svd(matrices.double())
    # Zeros are zeros up to rounding, which a small power would raise.
    kept = values > values[:, :1] * 1e-12
    powers = torch.where(kept, values, 1.0).pow(exponent) * kept
    return ((u * powers[:, None, :]) @ v).to(matrices.dtype)


def descriptor_of(
    features: Float[Tensor, "b s n"], pooled: Float[Tensor, "b s n"], exponent: float = 0.5
) -> Float[Tensor, "b value"]:
    """Descriptors (b, n²) float32 of unit norm of features (b, s, n) and pooled ones.

    Rows of the normalised matrix have unit norm first, then the whole has; rows of zeros, and the
    descriptor of a scan without segments, stay zeros.
    """
    matrices = second_order(features, pooled)
    rows = F.normalize(power_normalised(matrices, exponent), dim=2)
    rows = rows * (matrices != 0).any(dim=2, keepdim=True)  # not rounding at unit norm
    return F.normalize(rows.flatten(1), dim=1).float()
