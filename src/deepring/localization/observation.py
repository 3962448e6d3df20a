"""What a map sees of scans: images from above and descriptors."""

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.errors import BrokenScanError, DataError
from deepring.localization.scan_points import scan_points
from deepring.methods.deepring import DeepRing
from deepring.rasters import BevRaster
from deepring.rasters.blank import blank_reason

#: Occupied cells that an image needs. Of unrelated scans cut down to 12 cells in a heap, half fit
#: each other at 0.57 or better, as neighbours do: it stands for nothing. See also `FEW_CELLS`.
LEAST_CELLS = 10


class Observation(NamedTuple):
    """Images and descriptors of k scans."""

    images: NDArray[np.bool_]
    """(k, n, n) occupancy from above."""
    descriptors: Tensor
    """(k, θ, ω) float32, on the CPU."""


def occupancy(name: str, points: Any, ground_z: float, raster: BevRaster) -> NDArray[np.bool_]:
    """Image (n, n) of one scan, whose points are as for `scan_points`; ``name`` names it.

    Raises DataError as `scan_points`, and BrokenScanError, with the cause, where less than
    `LEAST_CELLS` cells stand out of the ground.
    """
    scan = scan_points(name, points)
    image = raster(scan, ground_z)
    cells = int(image.sum())
    if cells < LEAST_CELLS:
        few = f"only {cells} cells stand" if cells else "nothing stands"
        reason = blank_reason(scan, ground_z, raster.preprocessing)
        raise BrokenScanError(f"{name}: {few} out of the ground: {reason}")
    return image


def described(network: DeepRing, images: NDArray[np.bool_]) -> Observation:
    """Images (k, n, n) with their descriptors."""
    return Observation(images, network.describe(torch.from_numpy(images)).cpu())


def observed(scans: Any, cells: tuple[int, int], shape: tuple[int, ...]) -> Observation:
    """The observation that a caller gives, of images of ``cells`` and descriptors of ``shape``.

    Raises DataError for anything else, and for images that `occupancy` would not give.
    """
    if not isinstance(scans, Observation):
        raise DataError(f"observation: a {type(scans).__name__}, expected what Map.observe gives")
    images, descriptors = scans
    if not isinstance(images, np.ndarray) or images.dtype != np.bool_:
        raise DataError(f"observation: images of a {type(images).__name__}, expected bool arrays")
    if images.ndim != 3 or images.shape[1:] != cells:
        raise DataError(f"observation: images {images.shape}, expected (k, {cells[0]}, {cells[1]})")
    if not isinstance(descriptors, Tensor) or not descriptors.is_floating_point():
        raise DataError("observation: descriptors expected as a tensor of float32")
    expected = (len(images), *shape)
    if tuple(descriptors.shape) != expected:
        raise DataError(
            f"observation: descriptors {tuple(descriptors.shape)}, expected {expected} for "
            f"{len(images)} images"
        )
    if not bool(torch.isfinite(descriptors).all()):
        raise DataError("observation: descriptors that are not finite; look at the network")
    if len(images) and int(images.sum(axis=(1, 2)).min()) < LEAST_CELLS:
        raise DataError(f"observation: an image of less than {LEAST_CELLS} occupied cells")
    return scans
