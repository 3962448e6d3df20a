"""Convolutions on the occupied voxels of a batch of scans, in plain torch.

Sites are integer coordinates (batch, θ, r, z), kept sorted. A kernel map lists which input site
feeds which output site at each offset of a kernel; it depends only on the sites and is built once
for all layers of one stride. Results equal torch's dense convolutions with zeros at the empty
sites. Source: Choy et al., "4D Spatio-Temporal ConvNets", CVPR 2019, Sec. 3.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float, Int64, Shaped
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from deepring import checks
from deepring.errors import ConfigError, DataError


@dataclass(frozen=True, eq=False)
class _KernelMap:
    """Pairs (offset, output rows, input rows), each row at most once per offset."""

    outputs: int
    pairs: tuple[tuple[int, Int64[Tensor, " _"], Int64[Tensor, " _"]], ...]
    centre: int | None = None  # the offset from each row to itself, without pairs

    def transposed(self, outputs: int) -> "_KernelMap":
        """The same pairs in the opposite direction."""
        return _KernelMap(outputs, tuple((k, b, a) for k, a, b in self.pairs))


def _keys(
    coordinates: Int64[Tensor, "n 4"], low: list[int], high: list[int]
) -> Int64[Tensor, " n"]:
    """One int64 per site, in the order of the coordinates, which are from ``low`` to ``high``."""
    keys = coordinates[:, 0] - low[0]
    for axis in (1, 2, 3):
        keys = keys * (high[axis] - low[axis] + 1) + (coordinates[:, axis] - low[axis])
    return keys


def _column(
    keys: Tensor, targets: Tensor, at: Tensor, offset: int, layers: int
) -> Iterator[tuple[int, Tensor, Tensor]]:
    """Pairs of ``layers`` consecutive offsets in z, starting at the rows of the first."""
    hits, rows = [], []
    for k in range(layers):
        hits.append(keys[at] == targets + k)
        rows.append(at)
        at = at + hits[-1]
    if not hits:
        return
    matches = torch.stack(hits)
    layer, outputs = matches.nonzero(as_tuple=True)
    inputs = torch.stack(rows)[layer, outputs]
    sizes: list[int] = matches.sum(1).tolist()
    runs = zip(torch.split(outputs, sizes), torch.split(inputs, sizes), strict=True)
    yield from ((offset + k, a, b) for k, (a, b) in enumerate(runs) if len(a))


class Grid:
    """The occupied sites of a batch at one stride, with the kernel maps over them.

    Args:
        coordinates: (n, 4) integer (batch, θ, r, z), units of the stride, unique; any order.
        stride: size of a site in voxels.
        wrap: sectors per turn at this stride, if θ wraps; None does not wrap, as in EgoNN.
        batch: number of scans; by default the largest batch index plus one.

    Raises:
        DataError: a scan without sites, repeated sites, or θ outside [0, wrap).
    """

    def __init__(
        self,
        coordinates: Shaped[Tensor, "..."],
        stride: int = 1,
        wrap: int | None = None,
        batch: int | None = None,
    ) -> None:
        shape = tuple(coordinates.shape)
        if coordinates.is_floating_point() or shape[1:] != (4,) or not shape[0]:
            raise DataError(
                f"coordinates: {shape} {coordinates.dtype}, expected (n, 4) integers "
                "(batch, θ, r, z), n >= 1"
            )
        coordinates = coordinates.long()
        low, high = torch.stack([coordinates.amin(0), coordinates.amax(0)]).tolist()
        if wrap is not None and not 0 <= low[1] <= high[1] < wrap:
            raise DataError(
                f"coordinates: θ from {low[1]} to {high[1]}, expected 0 to {wrap - 1}, one turn"
            )
        self._low, self._high, self.stride, self.wrap = low, high, stride, wrap
        keys, self.order = _keys(coordinates, low, high).sort()
        self.coordinates = coordinates[self.order]
        self._neighbours: dict[int, _KernelMap] = {}
        counts = torch.bincount(self.coordinates[:, 0], minlength=batch or 0)
        repeated = (keys[1:] == keys[:-1]).sum()
        self.counts: list[int]
        *self.counts, again = torch.cat([counts, repeated[None]]).tolist()
        if again or 0 in self.counts:
            raise DataError(
                f"coordinates: {again} repeated voxels, {self.counts} voxels in the scans of the "
                "batch; expected none repeated and one or more in each scan"
            )

    def __len__(self) -> int:
        return len(self.coordinates)

    def neighbours(self, kernel: int) -> _KernelMap:
        """The map of a stride-1 convolution with an odd kernel, from the sites to themselves."""
        if kernel not in self._neighbours:
            pairs = tuple(self._search(kernel))
            self._neighbours[kernel] = _KernelMap(len(self), pairs, centre=kernel**3 // 2)
        return self._neighbours[kernel]

    def _search(self, kernel: int) -> Iterator[tuple[int, Tensor, Tensor]]:
        """Search half of the offsets; the other half are the same pairs mirrored.

        The sites of one column (dθ, dr) are consecutive: one search finds the lowest dz, and each
        further dz is the same row or the next.
        """
        reach = kernel // 2
        # A margin that stays empty keeps the end of one axis from meeting the start of the next.
        low = [value - reach for value in self._low]
        high = [value + reach for value in self._high]
        if self.wrap is not None:
            low[1], high[1] = 0, self.wrap - 1
        keys = _keys(self.coordinates, low, high)
        ends = torch.cat([keys, keys.new_full((1,), torch.iinfo(torch.int64).max)])
        for sector in range(reach + 1):
            for ring in range(-reach if sector else 0, reach + 1):
                first = -reach if sector or ring else 1
                sites = self.coordinates + self.coordinates.new_tensor([0, sector, ring, first])
                if self.wrap is not None:
                    sites[:, 1] %= self.wrap
                targets = _keys(sites, low, high)
                at = torch.searchsorted(keys, targets)
                offset = ((sector + reach) * kernel + ring + reach) * kernel + first + reach
                for k, a, b in _column(ends, targets, at, offset, reach + 1 - first):
                    yield k, a, b
                    yield kernel**3 - 1 - k, b, a

    @cached_property
    def coarser(self) -> tuple["Grid", _KernelMap]:
        """The sites at twice the stride, floor(c / 2), and the map from this grid to that one."""
        if self.wrap is not None and self.wrap % 2:
            raise ConfigError(f"wrap: {self.wrap} sectors at stride {self.stride}, expected even")
        parents = self.coordinates.clone()
        parents[:, 1:] = parents[:, 1:].div(2, rounding_mode="floor")
        low, high = ([v[0], *(c // 2 for c in v[1:])] for v in (self._low, self._high))
        _, rows = torch.unique(_keys(parents, low, high), return_inverse=True)
        sites = parents.new_empty((int(rows.max()) + 1, 4)).index_copy_(0, rows, parents)
        grid = Grid(sites, 2 * self.stride, self.wrap and self.wrap // 2, len(self.counts))
        theta, ring, layer = (self.coordinates - 2 * parents)[:, 1:].unbind(1)
        offset, children = ((theta * 2 + ring) * 2 + layer).sort(stable=True)
        sizes = torch.bincount(offset, minlength=8).tolist()
        runs = zip(torch.split(rows[children], sizes), torch.split(children, sizes), strict=True)
        pairs = tuple((k, a, b) for k, (a, b) in enumerate(runs) if len(a))
        return grid, _KernelMap(len(grid), pairs)


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
    def stride(self) -> int:
        """Size of a site in voxels."""
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
    def forward(ctx: Any, features: Tensor, weight: Tensor, pairs: _KernelMap) -> Tensor:
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
        self, features: Float[Tensor, "n in"], pairs: _KernelMap
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

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.BatchNorm1d(channels)

    def forward(self, x: SparseTensor) -> SparseTensor:
        """Normalised features on the same sites."""
        if self.training and len(x.grid) < 2:
            raise DataError(f"batch: one site at stride {x.stride}, expected two for training")
        return x.put(self.norm(x.features))
