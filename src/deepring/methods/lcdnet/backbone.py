"""LCDNet's backbone: a sparse network over cubic voxels, four levels and a last layer along z.

Source: VoxelBackBone8x of SECOND and PV-RCNN (Shi et al., CVPR 2020), as LCDNet uses it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError
from deepring.nn.sparse import KernelConv, PointNorm, SparseTensor, SubmanifoldConv
from deepring.nn.sparse_grid import Grid

#: Padding of the three convolutions with kernel 3 and stride 2; the last is open along z.
_PADDING = ((1, 1, 1), (1, 1, 1), (1, 1, 0))

_EPS = 1e-3


class Level(NamedTuple):
    """Features on sites, and where these stand."""

    features: SparseTensor
    first: tuple[float, float, float]
    """The middle of site (0, 0, 0), in voxels from the corner: what its kernel is centred on."""

    def middles(self, corner: tuple[float, float, float], size: float) -> Float[Tensor, "n 3"]:
        """Where the sites stand (n, 3), metres, of voxels of ``size`` from ``corner``."""
        sites = self.features.coordinates[:, 1:].float()
        steps = sites.new_tensor(self.features.stride)
        return (sites * steps + sites.new_tensor(self.first)) * size + sites.new_tensor(corner)


class _Layer(nn.Module):
    """A convolution, normalised, with a ReLU."""

    def __init__(self, conv: nn.Module, channels: int, momentum: float) -> None:
        super().__init__()
        self.conv, self.norm = conv, PointNorm(channels, _EPS, momentum)

    def forward(self, x: SparseTensor) -> SparseTensor:
        y: SparseTensor = self.norm(self.conv(x))
        return y.put(F.relu(y.features))


def _levels_of(extent: int) -> int:
    """Layers that are left of ``extent`` after the whole network; 0 where some were not seen."""
    layers = extent
    for kernel, padding in ((3, 1), (3, 1), (3, 0), (3, 0)):
        if (layers + 2 * padding - kernel) < 0 or (padding == 0 and layers % 2 == 0):
            return 0
        layers = (layers + 2 * padding - kernel) // 2 + 1
    return layers


class Backbone(nn.Module):
    """Means of voxels -> levels of stride 1, 2, 4 and 8, and one of stride 8 seen from above.

    Args:
        channels: of the voxels.
        widths: channels of the four levels and of the last layer.
        layers: voxels along z; one more is added, as published. Of 40 they leave 20, 10, 5 and 2.
        momentum: with which the norms' statistics follow the batches.
    """

    def __init__(self, channels: int, widths: Sequence[int], layers: int, momentum: float) -> None:
        super().__init__()
        if len(checks.widths("lcdnet.widths", widths)) != 5:
            raise ConfigError(
                f"lcdnet.widths: {list(widths)}, expected five: of four levels and a last layer"
            )
        self.layers = _levels_of(layers + 1)
        if not self.layers:
            fitting = [n for n in range(8, 400) if _levels_of(n + 1)]
            near = sorted(sorted(fitting, key=lambda n: abs(n - layers))[:3])
            raise ConfigError(
                f"raster: {layers} voxels along z, expected a number of which the strides leave no "
                f"layer unseen, such as {', '.join(map(str, near))}; change raster.size or "
                "preprocessing.height"
            )

        def same(inputs: int, outputs: int) -> nn.Module:
            return _Layer(SubmanifoldConv(inputs, outputs), outputs, momentum)

        first, *others, last = widths
        self.stem = nn.Sequential(same(channels, first), same(first, first))
        self.stages = nn.ModuleList(
            nn.Sequential(
                _Layer(KernelConv(a, b, 3, 2, padding), b, momentum), same(b, b), same(b, b)
            )
            for a, b, padding in zip(widths[:3], others, _PADDING, strict=True)
        )
        along_z = KernelConv(widths[3], last, (1, 1, 3), (1, 1, 2), 0)
        self.last = _Layer(along_z, last, momentum)

    def forward(self, x: SparseTensor) -> tuple[list[Level], SparseTensor]:
        """The four levels, and the sites seen from above: the last axis has ``layers`` sites."""
        x = self.stem(x)
        first, stride = (0.5, 0.5, 0.5), 1
        levels = [Level(x, first)]
        for stage, padding in zip(self.stages, _PADDING, strict=True):
            x = stage(x)
            a, b, c = (c + stride * (1 - p) for c, p in zip(first, padding, strict=True))
            first, stride = (a, b, c), 2 * stride
            levels.append(Level(x, first))
        return levels, self.last(x)


def voxels(
    points: Float[Tensor, "batch n channel"],
    filled: Bool[Tensor, "batch n"],
    corner: tuple[float, float, float],
    size: float,
    extent: tuple[int, int, int],
) -> SparseTensor:
    """The mean of the points in each occupied voxel; sites are (batch, x, y, z).

    Args:
        points: (b, n, c) metres and what follows x, y and z.
        filled: (b, n), which of them count, and so do none outside the voxels.
        corner: where voxel (0, 0, 0) begins, metres.
        size: of a voxel, metres.
        extent: voxels along each axis; the grid has one more along z.

    Raises:
        DataError: a scan without points.
    """
    cells = ((points[..., :3] - points.new_tensor(corner)) / size).floor().long()
    ends = cells.new_tensor(extent)
    scan, row = (filled & ((cells >= 0) & (cells < ends)).all(dim=-1)).nonzero(as_tuple=True)
    x, y, z = cells[scan, row].unbind(1)
    keys = ((scan * extent[0] + x) * extent[1] + y) * extent[2] + z
    unique, voxel, counts = torch.unique(keys, return_inverse=True, return_counts=True)
    sums = points.new_zeros(len(unique), points.shape[2])
    sums.index_add_(0, voxel, points[scan, row])
    parts = []
    for length in reversed(extent):
        parts.append(unique % length)
        unique = unique.div(length, rounding_mode="floor")
    sites = torch.stack([unique, *reversed(parts)], dim=1)
    longer = (extent[0], extent[1], extent[2] + 1)
    return SparseTensor(sums / counts[:, None], Grid(sites, batch=len(points), extent=longer))
