"""PointNet's features per point, with its two learned alignments.

Source: Qi et al. (CVPR 2017, Sec. 4.2) and PointNetVLAD (Uy and Lee, CVPR 2018, Sec. 4;
mikacuy/pointnetvlad). Inside, points are the last axis, (b, channels, n), for 1x1 convolutions.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from deepring import checks
from deepring.errors import DataError


class SharedMlp(nn.Sequential):
    """The same layers for every point: linear, batch norm, ReLU. (b, in, n) -> (b, out, n).

    The linear layers have no bias, since batch norm has one; without ``norm`` they do. Such layers
    begin with Glorot's weights and biases of 0, as in the published TensorFlow code: PyTorch's own
    make the points of a cloud ever more alike from layer to layer.
    """

    def __init__(self, in_channels: int, widths: Sequence[int], *, norm: bool = True) -> None:
        layers: list[nn.Module] = []
        for source, width in zip([in_channels, *widths[:-1]], widths, strict=True):
            linear = nn.Conv1d(source, width, 1, bias=not norm)
            layers.append(linear)
            if norm:
                layers.append(nn.BatchNorm1d(width))
            elif linear.bias is not None:
                nn.init.xavier_uniform_(linear.weight)
                nn.init.zeros_(linear.bias)
            layers.append(nn.ReLU(inplace=True))
        super().__init__(*layers)


class TransformNet(nn.Module):
    """T-Net: one matrix per cloud, which aligns its points, (b, c, n) -> (b, c, c).

    A shared network, the maximum over the points, and a network of the whole cloud. The last
    layer starts at zero and the identity is added, so that training begins without a transform.
    Batch norm over clouds needs two or more of them in training.

    Args:
        channels: number c of channels of the points.
        widths: widths of the layers before the maximum.
        hidden: widths of the layers after it.
    """

    def __init__(
        self,
        channels: int,
        widths: Sequence[int] = (64, 128, 1024),
        hidden: Sequence[int] = (512, 256),
    ) -> None:
        super().__init__()
        self.shared = SharedMlp(channels, widths)
        layers: list[nn.Module] = []
        for source, width in zip([widths[-1], *hidden[:-1]], hidden, strict=True):
            layers += [nn.Linear(source, width, bias=False), nn.BatchNorm1d(width), nn.ReLU()]
        self.whole = nn.Sequential(*layers)
        self.last = nn.Linear(hidden[-1], channels * channels)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)
        self.identity: Tensor
        self.register_buffer("identity", torch.eye(channels), persistent=False)

    def forward(
        self, x: Float[Tensor, "batch channel n"]
    ) -> Float[Tensor, "batch channel channel"]:
        """Matrices T of the clouds x; the aligned points, as rows, are x^T T."""
        change = self.last(self.whole(self.shared(x).amax(dim=-1)))
        return change.view(-1, *self.identity.shape) + self.identity


class PointFeatures(nn.Module):
    """Features of each point of a cloud, (b, n, 3) -> (b, n, f): PointNet without its maximum.

    Points aligned by a 3x3 T-Net, MLP 64-64, features aligned by a 64x64 T-Net, MLP 64-128-1024.
    Every layer has batch norm and ReLU, including the last. In the published TensorFlow code only
    the T-Nets have batch norm; in the PyTorch ports only the MLPs, without the last ReLU.

    Args:
        first: widths of the MLP between the T-Nets.
        second: widths of the MLP after them; the last is f.
        transform_widths: widths of both T-Nets' layers before the maximum.
        transform_hidden: widths of both T-Nets' layers after it.
    """

    def __init__(
        self,
        first: Sequence[int] = (64, 64),
        second: Sequence[int] = (64, 128, 1024),
        transform_widths: Sequence[int] = (64, 128, 1024),
        transform_hidden: Sequence[int] = (512, 256),
    ) -> None:
        super().__init__()
        for name, widths in (
            ("first", first),
            ("second", second),
            ("transform_widths", transform_widths),
            ("transform_hidden", transform_hidden),
        ):
            checks.widths(f"pointnet.{name}", widths)
        self.align_points = TransformNet(3, transform_widths, transform_hidden)
        self.first = SharedMlp(3, first)
        self.align_features = TransformNet(first[-1], transform_widths, transform_hidden)
        self.second = SharedMlp(first[-1], second)

    def forward(self, points: Shaped[Tensor, "..."]) -> Float[Tensor, "batch n feature"]:
        """Features of points (b, n, 3). Raises DataError for another shape."""
        if points.dim() != 3 or points.shape[-1] != 3:
            raise DataError(f"points: shape {tuple(points.shape)}, expected (b, n, 3)")
        x = points.transpose(1, 2)
        x = self.first(aligned(self.align_points(x), x))
        x = self.second(aligned(self.align_features(x), x))
        return x.transpose(1, 2)


def aligned(
    transform: Float[Tensor, "batch channel channel"], x: Float[Tensor, "batch channel n"]
) -> Float[Tensor, "batch channel n"]:
    """Points x by their matrix T, x^T T, transposed back: (b, c, c), (b, c, n) -> (b, c, n)."""
    return torch.bmm(transform.transpose(1, 2), x)
