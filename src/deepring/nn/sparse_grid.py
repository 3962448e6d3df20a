"""The occupied voxels of a batch of scans: sites, and which of them a kernel joins.

Sites are integer coordinates (batch, θ, r, z), or (batch, x, y, z), kept sorted. A kernel map
lists which input site feeds which output site at each offset of a kernel; it depends only on the
sites and is built once for all layers of one stride. Source: Choy et al., "4D Spatio-Temporal
ConvNets", CVPR 2019, Sec. 3.
"""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Int64, Shaped
from torch import Tensor

from deepring.errors import ConfigError, DataError

Lengths = tuple[int, int, int]
"""A number for each axis (θ, r, z), or (x, y, z)."""


@dataclass(frozen=True, eq=False)
class KernelMap:
    """Pairs (offset, output rows, input rows), each row at most once per offset."""

    outputs: int
    pairs: tuple[tuple[int, Int64[Tensor, " _"], Int64[Tensor, " _"]], ...]
    centre: int | None = None  # the offset from each row to itself, without pairs

    def transposed(self, outputs: int) -> "KernelMap":
        """The same pairs in the opposite direction."""
        return KernelMap(outputs, tuple((k, b, a) for k, a, b in self.pairs))


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


def _lengths(values: Iterable[int]) -> Lengths:
    first, second, third = values
    return first, second, third


def scaled(stride: int | Lengths, by: Lengths) -> int | Lengths:
    """A size of sites times one number for each axis; one number where all three are equal.

    >>> scaled(4, (2, 2, 2)), scaled(8, (1, 1, 2))
    (8, (8, 8, 16))
    """
    before = (stride,) * 3 if isinstance(stride, int) else stride
    sizes = _lengths(a * b for a, b in zip(before, by, strict=True))
    return sizes[0] if len(set(sizes)) == 1 else sizes


class Grid:
    """The occupied sites of a batch at one stride, with the kernel maps over them.

    Args:
        coordinates: (n, 4) integer (batch, θ, r, z), units of the stride, unique; any order.
        stride: size of a site in voxels, one number or one for each axis.
        wrap: sectors per turn at this stride, if θ wraps; None does not wrap, as in EgoNN.
        batch: number of scans; by default the largest batch index plus one.
        extent: lengths of the three axes, in sites; None has no ends.

    Raises:
        DataError: a scan without sites, repeated sites, θ outside [0, wrap), or sites outside
            ``extent``.
    """

    def __init__(
        self,
        coordinates: Shaped[Tensor, "..."],
        stride: int | Lengths = 1,
        wrap: int | None = None,
        batch: int | None = None,
        extent: Lengths | None = None,
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
        if extent is not None and not all(
            0 <= low[axis + 1] <= high[axis + 1] < extent[axis] for axis in range(3)
        ):
            raise DataError(
                f"coordinates: from {low[1:]} to {high[1:]}, expected sites of 0 to one less than "
                f"extent={list(extent)}"
            )
        self._low, self._high, self.stride, self.wrap = low, high, stride, wrap
        self.extent = extent
        self._keys, self.order = _keys(coordinates, low, high).sort()
        self.coordinates = coordinates[self.order]
        self._neighbours: dict[int, KernelMap] = {}
        self._strided: dict[tuple[Lengths, Lengths, Lengths], tuple[Grid, KernelMap]] = {}
        counts = torch.bincount(self.coordinates[:, 0], minlength=batch or 0)
        repeated = (self._keys[1:] == self._keys[:-1]).sum()
        self.counts: list[int]
        *self.counts, again = torch.cat([counts, repeated[None]]).tolist()
        if again or 0 in self.counts:
            raise DataError(
                f"coordinates: {again} repeated voxels, {self.counts} voxels in the scans of the "
                "batch; expected none repeated and one or more in each scan"
            )

    def __len__(self) -> int:
        return len(self.coordinates)

    def rows(self, sites: Int64[Tensor, "m 4"]) -> Int64[Tensor, " m"]:
        """The row of each site (batch, θ, r, z), anywhere; -1 where it is not occupied."""
        low, high = (sites.new_tensor(ends) for ends in (self._low, self._high))
        inside = ((sites >= low) & (sites <= high)).all(dim=1)
        targets = _keys(sites, self._low, self._high)
        at = torch.searchsorted(self._keys, targets).clamp_max(len(self) - 1)
        return torch.where(inside & (self._keys[at] == targets), at, -1)

    def neighbours(self, kernel: int) -> KernelMap:
        """The map of a stride-1 convolution with an odd kernel, from the sites to themselves."""
        if kernel not in self._neighbours:
            pairs = tuple(self._search(kernel))
            self._neighbours[kernel] = KernelMap(len(self), pairs, centre=kernel**3 // 2)
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
    def coarser(self) -> tuple["Grid", KernelMap]:
        """The sites at twice the stride, floor(c / 2), and the map from this grid to that one."""
        if self.wrap is not None and self.wrap % 2:
            raise ConfigError(f"wrap: {self.wrap} sectors at stride {self.stride}, expected even")
        parents = self.coordinates.clone()
        parents[:, 1:] = parents[:, 1:].div(2, rounding_mode="floor")
        low, high = ([v[0], *(c // 2 for c in v[1:])] for v in (self._low, self._high))
        _, rows = torch.unique(_keys(parents, low, high), return_inverse=True)
        sites = parents.new_empty((int(rows.max()) + 1, 4)).index_copy_(0, rows, parents)
        extent = self.extent and _lengths((length + 1) // 2 for length in self.extent)
        grid = Grid(
            sites,
            scaled(self.stride, (2, 2, 2)),
            self.wrap and self.wrap // 2,
            len(self.counts),
            extent,
        )
        theta, ring, layer = (self.coordinates - 2 * parents)[:, 1:].unbind(1)
        offset, children = ((theta * 2 + ring) * 2 + layer).sort(stable=True)
        sizes = torch.bincount(offset, minlength=8).tolist()
        runs = zip(torch.split(rows[children], sizes), torch.split(children, sizes), strict=True)
        pairs = tuple((k, a, b) for k, (a, b) in enumerate(runs) if len(a))
        return grid, KernelMap(len(grid), pairs)

    def strided(
        self, kernel: Lengths, stride: Lengths, padding: Lengths
    ) -> tuple["Grid", KernelMap]:
        """The sites of a convolution with these sizes, and the map from this grid to that one.

        Site o sees the sites o * stride - padding + k, with k from 0 to kernel - 1 on each axis, as
        in torch; every o that sees one of this grid is a site. Where the grid has an ``extent``,
        so has the other: (extent + 2 padding - kernel) // stride + 1, and there are none beyond.

        Raises:
            ConfigError: a grid whose θ wraps, or an axis too short for the kernel.
            DataError: a scan of which no site is left, since all lie at an end.
        """
        sizes = (kernel, stride, padding)
        if sizes not in self._strided:
            if self.wrap is not None:
                raise ConfigError(
                    f"wrap: {self.wrap} sectors, expected None; strided kernels do not wrap"
                )
            self._strided[sizes] = self._striding(*sizes)
        return self._strided[sizes]

    def _striding(
        self, kernel: Lengths, stride: Lengths, padding: Lengths
    ) -> tuple["Grid", KernelMap]:
        extent = self.extent and _lengths(
            (length + 2 * p - k) // s + 1
            for length, k, s, p in zip(self.extent, kernel, stride, padding, strict=True)
        )
        if extent is not None and min(extent) < 1:
            raise ConfigError(
                f"extent: {list(self.extent or ())} sites, expected axes that a kernel of "
                f"{list(kernel)} with padding {list(padding)} fits into"
            )
        found = tuple(self._seen_from(kernel, stride, padding, extent))
        if not found:
            raise DataError("coordinates: no site is left, expected some away from the ends")
        sites = torch.cat([outputs for _, outputs, _ in found])
        low, high = torch.stack([sites.amin(0), sites.amax(0)]).tolist()
        unique, rows = torch.unique(_keys(sites, low, high), return_inverse=True)
        outputs = sites.new_empty((len(unique), 4)).index_copy_(0, rows, sites)
        batch = len(self.counts)
        grid = Grid(outputs, scaled(self.stride, stride), batch=batch, extent=extent)
        runs = torch.split(rows, [len(inputs) for _, _, inputs in found])
        pairs = ((k, a, inputs) for (k, _, inputs), a in zip(found, runs, strict=True))
        return grid, KernelMap(len(grid), tuple(pairs))

    def _seen_from(
        self, kernel: Lengths, stride: Lengths, padding: Lengths, extent: Lengths | None
    ) -> Iterator[tuple[int, Tensor, Tensor]]:
        """For each offset of the kernel: the sites that see one of this grid, and its row.

        An offset joins only the sites of one remainder, so those are sorted out first.
        """
        shifted = self.coordinates + self.coordinates.new_tensor([0, *padding])
        steps = shifted.new_tensor(stride)
        remainders = shifted[:, 1:] % steps
        for remainder in itertools.product(*map(range, stride)):
            rows = (remainders == shifted.new_tensor(remainder)).all(dim=1).nonzero()[:, 0]
            offsets = (range(r, k, s) for r, k, s in zip(remainder, kernel, stride, strict=True))
            for offset in itertools.product(*offsets):
                sites = shifted[rows] - shifted.new_tensor([0, *offset])
                sites[:, 1:] = sites[:, 1:].div(steps, rounding_mode="floor")
                inputs = rows
                if extent is not None:
                    ends = sites.new_tensor(extent)
                    inside = ((sites[:, 1:] >= 0) & (sites[:, 1:] < ends)).all(dim=1)
                    sites, inputs = sites[inside], rows[inside]
                if len(inputs):
                    number = (offset[0] * kernel[1] + offset[1]) * kernel[2] + offset[2]
                    yield number, sites, inputs
