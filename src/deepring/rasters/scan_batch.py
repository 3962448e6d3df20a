"""Many scans to their images at once in plain torch: on a GPU without leaving it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from deepring.errors import DeepringError
from deepring.rasters.bev import disc_mask
from deepring.rasters.kinds import BevRaster, ContextRaster, PolarRaster, RangeRaster, Raster
from deepring.rasters.preprocessing import Preprocessing


class _Points(NamedTuple):
    """Points of all scans: of which each is, and its coordinates, (n,) each."""

    scan: Tensor
    x: Tensor
    y: Tensor
    z: Tensor

    def where(self, mask: Tensor) -> "_Points":
        return _Points(*(values[mask] for values in self))


def scans_to_images(scans: Sequence[Tensor], ground_z: float, raster: Raster) -> Tensor:
    """What ``raster`` makes of each scan, as one batch (b, *raster.shape).

    Bird's-eye images are those of `BevRaster` on the CPU, cell by cell. In polar images a point
    within rounding of a cell's border may fall to the neighbour.

    Args:
        scans: (n, 3) float32 each, metres, all on one device.
        ground_z: z of the ground under the sensor in the scans' frames, metres.
        raster: for a bird's-eye image, a polar gram, Scan Context or a range image.

    Raises:
        DeepringError: no scans, or another raster.
    """
    if not scans:
        raise DeepringError("scans: none; expected at least one")
    count = len(scans)
    match raster:
        case BevRaster():
            return _bev(_kept(scans, ground_z, raster.preprocessing), count, raster)
        case PolarRaster():
            points = _kept(scans, ground_z, raster.preprocessing)
            ring = _distance(points) / raster.radius * raster.rings
            heights = _extreme(points, points.z, ring, count, raster.shape, -math.inf, "amax")
            return heights > -math.inf
        case ContextRaster():
            points = _kept(scans, ground_z, raster.preprocessing)
            ring = _distance(points) / raster.radius * raster.rings
            return _extreme(points, points.z, ring, count, raster.shape, 0.0, "amax").half()
        case RangeRaster():
            points = _kept(scans, ground_z, raster.preprocessing)
            return _closeness(points, count, raster).half()
    raise DeepringError(f"raster: {type(raster).__name__} is not drawn in batches; draw each scan")


def _kept(scans: Sequence[Tensor], ground_z: float, preprocessing: Preprocessing) -> _Points:
    """What the preprocessing leaves, with z above the nominal ground."""
    lengths = torch.tensor([len(scan) for scan in scans])
    xyz = torch.cat([scan[:, :3] for scan in scans]).float()
    owner = torch.arange(len(scans)).repeat_interleave(lengths).to(xyz.device)
    points = _Points(owner, *xyz.unbind(dim=1))
    low, high = (_single(height + ground_z) for height in preprocessing.height)
    box = _single(preprocessing.extent)
    inside = (points.x.abs() < box) & (points.y.abs() < box)
    points = points.where(inside & (points.z > low) & (points.z < high))
    if preprocessing.clearance is not None:
        floor = _floor(points, len(scans), preprocessing)
        points = points.where(points.z > floor + _single(preprocessing.clearance))
    return points._replace(z=points.z - _single(ground_z))


def _floor(points: _Points, scans: int, preprocessing: Preprocessing) -> Tensor:
    """The lowest z around each point: within a window of cells of its scan."""
    side, window = preprocessing.side, preprocessing.window
    half, scale = _single(side * preprocessing.cell / 2), _single(1.0 / preprocessing.cell)
    cell = ((points.x + half) * scale).long() * side + ((points.y + half) * scale).long()
    cell += points.scan * side * side
    lowest = torch.full((scans * side * side,), torch.inf, device=points.z.device)
    lowest.scatter_reduce_(0, cell, points.z, "amin")
    around = -F.max_pool2d(-lowest.view(scans, 1, side, side), window, 1, window // 2)
    return around.flatten()[cell]


def _bev(points: _Points, scans: int, raster: BevRaster) -> Tensor:
    cells = raster.cells
    scale, half = _single(cells / (2.0 * raster.extent)), _single(raster.extent)
    i = ((points.x + half) * scale).floor().long()
    j = ((points.y + half) * scale).floor().long()
    seen = (i >= 0) & (i < cells) & (j >= 0) & (j < cells)
    image = torch.zeros(scans, cells, cells, dtype=torch.bool, device=i.device)
    image[points.scan[seen], i[seen], j[seen]] = True
    return image & torch.from_numpy(disc_mask(cells).copy()).to(i.device)


def _closeness(points: _Points, scans: int, raster: RangeRaster) -> Tensor:
    """1 - range / max_range of the nearest return in each direction."""
    flat, z = _distance(points), points.z - raster.viewpoint
    low, high = (math.radians(angle) for angle in raster.elevation)
    row = (torch.atan2(z, flat) - low) / (high - low) * raster.rows
    reach = torch.sqrt(flat.square() + z.square())
    start = _single(raster.max_range)
    nearest = _extreme(points, reach, row, scans, raster.shape, start, "amin")
    return 1.0 - nearest / start


def _extreme(
    points: _Points,
    values: Tensor,
    column: Tensor,
    scans: int,
    shape: tuple[int, int],
    start: float,
    reduce: str,
) -> Tensor:
    """The largest or smallest value in each cell (b, θ, columns), ``start`` where there is none."""
    sectors, columns = shape
    turn = torch.atan2(points.y, points.x) / (2.0 * math.pi)
    sector = ((turn - turn.floor()) * sectors).long() % sectors
    whole = column.floor().long()
    seen = (whole >= 0) & (whole < columns)
    cell = (points.scan * sectors + sector) * columns + whole
    image = torch.full((scans * sectors * columns,), start, device=values.device)
    image.scatter_reduce_(0, cell[seen], values[seen], reduce)
    return image.view(scans, sectors, columns)


def _distance(points: _Points) -> Tensor:
    return torch.sqrt(points.x.square() + points.y.square())


def _single(value: float) -> float:
    """Rounded to float32, as the compiled loops have it."""
    return float(torch.tensor(value, dtype=torch.float32))
