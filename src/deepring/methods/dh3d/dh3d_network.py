"""DH3D's three parts: local features of points, how far a point can be relied on, and the place.

Source: Du, Wang, Cremers, ECCV 2020, Sec. 3; JuanDuGit/DH3D. Every linear layer has a bias, and
batch norm after it, but the last of a gate, of the detector and of the attention.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from deepring.methods.dh3d.point_graph import PointGraph
from deepring.nn.flex_conv import FlexConv
from deepring.nn.neighbourhoods import gathered
from deepring.nn.netvlad import NetVlad


class PointNorm(nn.BatchNorm1d):
    """Batch norm over all points of all clouds: (b, n, c) -> (b, n, c)."""

    def forward(self, x: Tensor) -> Tensor:
        """Normalise x."""
        return super().forward(x.flatten(0, 1)).view_as(x)


class PointLayer(nn.Sequential):
    """The same linear layer for every point, batch norm and ReLU: (b, n, c) -> (b, n, width)."""

    def __init__(self, channels: int, width: int, *, relu: bool = True) -> None:
        layers = [nn.Linear(channels, width), PointNorm(width)]
        super().__init__(*layers, *([nn.ReLU()] if relu else []))


class FlexLayer(nn.Module):
    """FlexConv, batch norm and ReLU."""

    def __init__(self, channels: int, width: int) -> None:
        super().__init__()
        self.conv = FlexConv(channels, width)
        self.norm = PointNorm(width)

    def forward(self, features: Tensor, points: Tensor, near: Tensor) -> Tensor:
        """Features (b, n, width), see `FlexConv`."""
        mixed: Tensor = self.norm(self.conv(features, points, near))
        return mixed.relu()


class Squeeze(nn.Module):
    """Squeeze and excitation: relu(x + x g), g a gate in (0, 1) of each channel of a cloud.

    The gate is a network of the channels' largest values.
    """

    def __init__(self, channels: int, hidden: int) -> None:
        super().__init__()
        self.gate = nn.Sequential(
            nn.Linear(channels, hidden), nn.ReLU(), nn.Linear(hidden, channels), nn.Sigmoid()
        )

    def forward(self, x: Float[Tensor, "batch n c"]) -> Float[Tensor, "batch n c"]:
        """The gated features."""
        return (x + x * self.gate(x.amax(dim=1))[:, None]).relu()


class LocalEncoder(nn.Module):
    """Features of each point from its surroundings, (b, n, width).

    A layer of the differences to the neighbours, two FlexConvs among all points, two among the
    coarse ones, both stages gated; together again at all points.

    Args:
        stem: width of the layer of differences.
        first: width of the stage among all points.
        second: width of the stage among the coarse points.
        gates: hidden widths of the two gates.
        width: of the features.
    """

    def __init__(
        self, stem: int, first: int, second: int, gates: tuple[int, int], width: int
    ) -> None:
        super().__init__()
        self.stem = PointLayer(3, stem)
        self.first = nn.ModuleList([FlexLayer(stem, first), FlexLayer(first, first)])
        self.first_gate = Squeeze(first, gates[0])
        self.first_out = PointLayer(first, first)
        self.second = nn.ModuleList([FlexLayer(first, second), FlexLayer(second, second)])
        self.second_gate = Squeeze(second, gates[1])
        self.joined = PointLayer(first + second, width, relu=False)
        self.shortcut = PointLayer(first, width, relu=False)

    def forward(self, graph: PointGraph) -> Float[Tensor, "batch n width"]:
        """The features of a graph's points."""
        shape = graph.near.shape
        around = gathered(graph.points, graph.near.flatten(1)).view(*shape, 3)
        offsets = around - graph.points[:, :, None]
        x = self.stem(offsets.flatten(1, 2)).unflatten(1, shape[1:]).amax(dim=2)
        for layer in self.first:
            x = layer(x, graph.points, graph.near)
        first = self.first_out(self.first_gate(x))
        x = graph.coarsened(first)
        for layer in self.second:
            x = layer(x, graph.coarse, graph.coarse_near)
        second = graph.spread(self.second_gate(x))
        joined: Tensor = self.joined(torch.cat([first, second], dim=-1)) + self.shortcut(first)
        return joined


class Detector(nn.Sequential):
    """Features (b, n, c) -> logits (b, n, 1) of how far a point can be relied on."""

    def __init__(self, channels: int, widths: Sequence[int]) -> None:
        sources = [channels, *widths[:-1]]
        layers = [PointLayer(source, width) for source, width in zip(sources, widths, strict=True)]
        super().__init__(*layers, nn.Linear(widths[-1], 1))


class PlaceHead(nn.Module):
    """One vector of a cloud: FlexConv among the coarse points, attention, NetVLAD.

    Args:
        channels: of the local features.
        width: of the features that are aggregated.
        attention: hidden width of the attention.
        clusters, dimension, gating: as in `NetVlad`.
    """

    def __init__(
        self,
        channels: int,
        width: int,
        attention: int,
        clusters: int,
        dimension: int,
        *,
        gating: bool,
    ) -> None:
        super().__init__()
        self.flex = FlexLayer(channels, width)
        self.attention = nn.Sequential(PointLayer(width, attention), nn.Linear(attention, 1))
        self.aggregate = NetVlad(width, clusters, dimension, gating=gating)

    def forward(
        self, graph: PointGraph, local: Float[Tensor, "batch n c"]
    ) -> Float[Tensor, "batch value"]:
        """Vectors (b, dimension), without unit norm."""
        coarse = self.flex(graph.coarsened(local), graph.coarse, graph.coarse_near)
        features = graph.spread(coarse)
        weights = torch.sigmoid(self.attention(features))[..., 0]
        vector: Tensor = self.aggregate(features, weights)
        return vector
