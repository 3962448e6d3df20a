"""Convolutions on the occupied voxels of a batch of scans, in plain torch.

Results equal torch's dense convolutions with zeros at the empty sites. Source: Choy et al.,
"4D Spatio-Temporal ConvNets", CVPR 2019, Sec. 3.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int64, Shaped
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.nn.sparse_grid import Grid, KernelMap, Lengths


@dataclass(frozen=True, eq=False)
class SparseTensor:
    """Features (n, c) on the n sites of a grid, in the grid's order."""

    features: Float[Tensor, "n channel"]
    grid: Grid

    @classmethod
    def of(
        cls,
        features: Shaped[Tensor, "..."],
        coordinates: Shaped[Tensor, "..."],
        **grid_options: Any,
    ) -> "SparseTensor":
        """A sparse tensor of rows in any order; see `Grid` for options and errors."""
        grid = Grid(coordinates, **grid_options)
        if features.ndim != 2 or len(features) != len(grid):
            shape = tuple(features.shape)
            raise DataError(f"features: {shape}, expected ({len(grid)}, channels)")
        return cls(features[grid.order], grid)

    @property
    def coordinates(self) -> Int64[Tensor, "n 4"]:
        """Sites (n, 4) int64 (batch, θ, r, z), sorted, in units of the stride."""
        return self.grid.coordinates

    @property
    def stride(self) -> int | Lengths:
        """Size of a site in voxels, one number or one for each axis."""
        return self.grid.stride

    def put(self, features: Float[Tensor, "n channel"]) -> "SparseTensor":
        """Other features on the same sites."""
        return SparseTensor(features, self.grid)

    def scans(self) -> tuple[Float[Tensor, "_ channel"], ...]:
        """The features of each scan of the batch, as views."""
        return torch.split(self.features, self.grid.counts)


class _GatherMultiplyAdd(torch.autograd.Function):
    """out[a] = Σ_k x[b] W_k over the pairs (k, a, b); stores no gathered rows for backward."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, weight: Tensor, pairs: KernelMap) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.map = pairs
        if pairs.centre is None:
            out = features.new_zeros(pairs.outputs, weight.shape[2])
        else:
            out = features @ weight[pairs.centre]
        for k, a, b in pairs.pairs:
            out.index_add_(0, a, features.index_select(0, b) @ weight[k])
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, Tensor, None]:
        features, weight = ctx.saved_tensors
        centre, grad_features = ctx.map.centre, None
        grad_weight = torch.zeros_like(weight)
        if ctx.needs_input_grad[0]:
            grad_features = (
                torch.zeros_like(features) if centre is None else grad @ weight[centre].T
            )
        if centre is not None:
            grad_weight[centre] = features.T @ grad
        for k, a, b in ctx.map.pairs:
            part = grad.index_select(0, a)
            grad_weight[k] = features.index_select(0, b).T @ part
            if grad_features is not None:
                grad_features.index_add_(0, b, part @ weight[k].T)
        return grad_features, grad_weight, None


class _SparseConv(nn.Module):
    """A weight (offsets, in, out) without bias; offsets run over θ, r, z, the last fastest."""

    def __init__(self, in_channels: int, out_channels: int, offsets: int, fan: int) -> None:
        super().__init__()
        bound = 1 / math.sqrt(fan * offsets)
        weight = torch.empty(offsets, in_channels, out_channels).uniform_(-bound, bound)
        self.weight = nn.Parameter(weight)

    def apply_map(
        self, features: Float[Tensor, "n in"], pairs: KernelMap
    ) -> Float[Tensor, "{pairs.outputs} out"]:
        """Sum over the pairs, in the weight's precision even under autocast."""
        with torch.autocast(features.device.type, enabled=False):
            features = features.to(self.weight.dtype)
            return _GatherMultiplyAdd.apply(features, self.weight, pairs)  # type: ignore[no-untyped-call]


class SubmanifoldConv(_SparseConv):
    """Convolution of stride 1 with an odd kernel; the sites do not change."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int = 3) -> None:
        if checks.count("kernel", kernel) % 2 == 0:
            raise ConfigError(f"kernel: {kernel}, expected an odd number")
        super().__init__(in_channels, out_channels, kernel**3, in_channels)
        self.kernel = kernel

    def forward(self, x: SparseTensor) -> SparseTensor:
        """Features (n, out) on the same sites."""
        return x.put(self.apply_map(x.features, x.grid.neighbours(self.kernel)))


class StridedConv(_SparseConv):
    """Convolution with kernel 2 and stride 2, onto the sites floor(c / 2)."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(in_channels, out_channels, 8, in_channels)

    def forward(self, x: SparseTensor) -> SparseTensor:
        """Features (m, out) on the coarser grid."""
        grid, pairs = x.grid.coarser
        return SparseTensor(self.apply_map(x.features, pairs), grid)


class KernelConv(_SparseConv):
    """Convolution of any kernel, stride and padding, onto every site that the kernel touches.

    One number stands for three. Source: the regular sparse convolution of Graham and van der
    Maaten (2017), as SECOND and PV-RCNN use it (kernel 3, stride 2; kernel 3 in z alone).
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int | Lengths = 3,
        stride: int | Lengths = 2,
        padding: int | Lengths = 1,
    ) -> None:
        self.kernel, self.stride = _three("kernel", kernel, 1), _three("stride", stride, 1)
        self.padding = _three("padding", padding, 0)
        super().__init__(in_channels, out_channels, math.prod(self.kernel), in_channels)

    def forward(self, x: SparseTensor) -> SparseTensor:
        """Features (m, out) on the sites of `Grid.strided`; see there for errors."""
        grid, pairs = x.grid.strided(self.kernel, self.stride, self.padding)
        return SparseTensor(self.apply_map(x.features, pairs), grid)


class TransposedConv(_SparseConv):
    """Transposed convolution with kernel 2 and stride 2, from a coarser grid to its finer one."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(in_channels, out_channels, 8, out_channels)

    def forward(self, x: SparseTensor, onto: Grid) -> SparseTensor:
        """Features (n, out) on ``onto``, whose `coarser` grid must be that of ``x``."""
        grid, pairs = onto.coarser
        if grid is not x.grid:
            raise DataError(
                f"onto: a grid of stride {onto.stride} with another `coarser` grid, expected the "
                f"one that the features of stride {x.stride} came from"
            )
        return SparseTensor(self.apply_map(x.features, pairs.transposed(len(onto))), onto)


class PointNorm(nn.Module):
    """Batch normalisation over all sites of the batch; training needs two or more."""

    def __init__(self, channels: int, eps: float = 1e-5, momentum: float = 0.1) -> None:
        super().__init__()
        self.norm = nn.BatchNorm1d(channels, eps, momentum)

    def forward(self, x: SparseTensor) -> SparseTensor:
        """Normalised features on the same sites."""
        if self.training and len(x.grid) < 2:
            raise DataError(f"batch: one site at stride {x.stride}, expected two for training")
        return x.put(self.norm(x.features))


def _three(name: str, value: int | Lengths, least: int) -> Lengths:
    """A number for each axis, each at least ``least``."""
    first, second, third = (value,) * 3 if isinstance(value, int) else value
    for length in (first, second, third):
        checks.count(name, length, least)
    return first, second, third
