"""Turning the rasters of scans, as if the scan had been turned: for augmentation, and for labels.

Exact for turns by whole sectors where an axis is azimuth; a BEV's square grid has no such turn.
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor

from deepring.errors import DeepringError
from deepring.rasters.kinds import ContextRaster, HeightRaster, PolarRaster, RangeRaster, Raster
from deepring.rasters.point_rasters import PointsRaster, VoxelRaster
from deepring.rasters.voxels import PADDING, sectors_of

Turner = Callable[[Tensor, Tensor], Tensor]
"""Turns images (n, *raster.shape) by a number of sectors each, (n,) int64, counter-clockwise."""


def sectors_in(raster: Raster) -> int:
    """Steps of a full turn by which the raster can be turned exactly.

    Points can be turned by any angle; 360 steps are offered. Raises DeepringError for a raster
    that cannot be turned.
    """
    match raster:
        case PolarRaster() | RangeRaster() | ContextRaster() | HeightRaster():
            return raster.sectors
        case VoxelRaster():
            return sectors_of(raster.degrees)
        case PointsRaster():
            return 360
    raise DeepringError(
        f"augmentation: a {type(raster).__name__} cannot be turned once it is drawn; take a raster "
        "with an axis of azimuth, points or voxels, or no turns"
    )


def turn_rasters(raster: Raster, images: Tensor, sectors: Tensor) -> Tensor:
    """Images (n, *raster.shape) as the raster would draw them of scans turned by whole sectors.

    ``sectors`` is (n,) int64, of `sectors_in`, counter-clockwise.
    """
    steps = sectors_in(raster)
    match raster:
        case VoxelRaster():
            return _turn_voxels(images, sectors, steps)
        case PointsRaster():
            return _turn_points(images, sectors * (2 * math.pi / steps))
    rows = (torch.arange(steps)[None] - sectors[:, None]) % steps  # rolled by +sectors
    shape = [len(images), *[1] * (images.dim() - 3), steps, 1]
    return images.gather(-2, rows.view(shape).expand_as(images))


def _turn_voxels(voxels: Tensor, sectors: Tensor, steps: int) -> Tensor:
    """The order of the rows is not restored; networks sort them themselves."""
    theta = voxels[..., 0].long()
    turned = (theta + sectors[:, None]) % steps
    kept = torch.where(theta == PADDING, theta, turned).to(voxels.dtype)
    return torch.cat([kept[..., None], voxels[..., 1:]], dim=-1)


def _turn_points(points: Tensor, yaw: Tensor) -> Tensor:
    x, y, z = points.float().unbind(-1)
    c, s = yaw.float().cos()[:, None], yaw.float().sin()[:, None]
    return torch.stack([c * x - s * y, s * x + c * y, z], dim=-1).to(points.dtype)
