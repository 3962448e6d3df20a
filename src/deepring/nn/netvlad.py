"""NetVLAD: aggregates features into one vector by their residuals to learned centres.

Source: Arandjelovic et al. (CVPR 2016, Sec. 3.1), with the projection and context gating of
Miech et al. (LOUPE, 2017) as PointNetVLAD uses them (mikacuy/pointnetvlad, loupe.py).
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from deepring import checks


class ContextGating(nn.Module):
    """Multiplies each component by its gate, x ⊙ σ(BN(x W)): (b, d) -> (b, d)."""

    def __init__(self, dimension: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(dimension, dimension) / dimension**0.5)
        self.norm = nn.BatchNorm1d(dimension)

    def forward(self, x: Float[Tensor, "batch value"]) -> Float[Tensor, "batch value"]:
        """Gate x."""
        return x * torch.sigmoid(self.norm(x @ self.weight))


class NetVlad(nn.Module):
    """Maps features (b, n, f) of n points in any order to vectors (b, dimension).

    The weights of the assignment and the centres are learned separately. Batch norm follows the
    projection and needs two or more clouds in training. The output is not normalised.

    Args:
        features: number f of features per point.
        clusters: number of centres.
        dimension: length of the vector.
        gating: whether context gating follows the projection.
    """

    def __init__(
        self, features: int = 1024, clusters: int = 64, dimension: int = 256, *, gating: bool = True
    ) -> None:
        super().__init__()
        for name, value in (
            ("features", features),
            ("clusters", clusters),
            ("dimension", dimension),
        ):
            checks.count(f"netvlad.{name}", value, most=8192)
        self.assignment = nn.Parameter(torch.randn(features, clusters) / features**0.5)
        self.assignment_norm = nn.BatchNorm1d(clusters)
        self.centres = nn.Parameter(torch.randn(clusters, features) / features**0.5)
        self.projection = nn.Parameter(torch.randn(clusters * features, dimension) / clusters**0.5)
        self.projection_norm = nn.BatchNorm1d(dimension)
        self.gate = ContextGating(dimension) if gating else nn.Identity()

    def residuals(
        self,
        x: Float[Tensor, "batch n feature"],
        attention: Float[Tensor, "batch n"] | None = None,
    ) -> Float[Tensor, "batch cluster feature"]:
        """V_k = Σ_i w_i a_k(x_i) (x_i - c_k), intra-normalised, all at unit norm: (b, clusters, f).

        a_k(x) is the softmax over k of BN(x W), w_i the attention (b, n) of each point, 1 without
        (PCAN, Zhang and Xiao, CVPR 2019). Each V_k has norm 1, or 0 if it is zero, before the whole
        is normalised.
        """
        logits = x @ self.assignment
        share = self.assignment_norm(logits.flatten(0, 1)).view_as(logits).softmax(dim=-1)
        if attention is not None:
            share = share * attention[..., None]
        vlad = share.transpose(1, 2) @ x - share.sum(dim=1).unsqueeze(-1) * self.centres
        return F.normalize(F.normalize(vlad, dim=2).flatten(1), dim=1).view_as(vlad)

    def forward(
        self,
        x: Float[Tensor, "batch n feature"],
        attention: Float[Tensor, "batch n"] | None = None,
    ) -> Float[Tensor, "batch value"]:
        """Vectors (b, dimension) of features (b, n, f), and of attention (b, n) where it counts."""
        vector = self.residuals(x, attention).flatten(1) @ self.projection
        return self.gate(self.projection_norm(vector))
