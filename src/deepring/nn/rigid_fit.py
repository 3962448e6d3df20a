"""The rigid transform that carries weighted points onto others, with gradients.

Source: Kabsch (1976) and Umeyama (1991), with weights as in RPM-Net and LCDNet.
"""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

#: Where the rotation about an axis is worth less than this share of the best, nothing tells it.
_LEAST = 1e-6


class _NearestRotation(torch.autograd.Function):
    """R that maximises tr(Rᵀ M), det R = 1, for matrices M (b, 3, 3).

    torch's gradient of the singular vectors divides by differences of singular values, though R
    depends smoothly on M where two of them are equal. With M = R P and P = V diag(p) Vᵀ, a change
    dM turns R by Rᵀ dR = V ([Vᵀ (Rᵀ dM - dMᵀ R) V]_ij / (p_i + p_j)) Vᵀ, which divides by sums. A
    sum of 0 is an axis about which M tells no rotation; no gradient comes from there.
    """

    @staticmethod
    def forward(ctx: Any, matrix: Tensor) -> tuple[Tensor, Tensor]:
        left, values, right = torch.linalg.svd(matrix)
        signs = torch.ones_like(values)
        signs[:, 2] = torch.linalg.det(left @ right).sign()
        rotation = left @ (signs[:, :, None] * right)
        stretch = values * signs
        ctx.save_for_backward(rotation, stretch, right)
        told = stretch[:, 1] + stretch[:, 2] > _LEAST * stretch[:, 0]
        ctx.mark_non_differentiable(told)
        return rotation, told

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor, _: Tensor) -> Tensor:
        rotation, stretch, right = ctx.saved_tensors
        sums = stretch[:, :, None] + stretch[:, None, :]
        told = sums > _LEAST * stretch[:, :1, None]
        weights = torch.where(told, 1 / torch.where(told, sums, 1.0), 0.0)
        turned = weights * (right @ rotation.transpose(1, 2) @ grad @ right.transpose(1, 2))
        return rotation @ right.transpose(1, 2) @ (turned - turned.transpose(1, 2)) @ right


def rigid_fit(
    points: Float[Tensor, "batch n 3"],
    targets: Float[Tensor, "batch n 3"],
    weights: Float[Tensor, "batch n"],
) -> tuple[Float[Tensor, "batch 4 4"], Tensor]:
    """The transforms T that minimise Σ w |T p - q|², and whether each is told: (b,) bool.

    The rotation has determinant 1, whatever the points, also where one cloud mirrors the other.
    It is not told by points on a line or at one place; then it is one of the equally good ones.

    Args:
        points: p (b, n, 3).
        targets: q (b, n, 3).
        weights: w (b, n), not negative; all 0 counts as equal.

    Returns:
        (b, 4, 4) float64, and (b,) bool. Gradients reach all three arguments.
    """
    points, targets, weights = points.double(), targets.double(), weights.double()
    total = weights.sum(dim=1, keepdim=True)
    share = torch.where(
        total > 0, weights / torch.where(total > 0, total, 1.0), 1 / weights.shape[1]
    )
    middle, onto = ((share[:, :, None] * x).sum(dim=1, keepdim=True) for x in (points, targets))
    spread = (targets - onto).transpose(1, 2) @ (share[:, :, None] * (points - middle))
    rotation, told = _NearestRotation.apply(spread)  # type: ignore[no-untyped-call]
    shift = onto.transpose(1, 2) - rotation @ middle.transpose(1, 2)
    last = points.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(len(points), 1, 4)
    return torch.cat([torch.cat([rotation, shift], dim=2), last], dim=1), told
