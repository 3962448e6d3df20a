"""Rasters of many scans in memory, with occupancy as bits."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.rasters import Raster


@dataclass(frozen=True, eq=False)
class Rasters:
    """Rasters of n scans in memory; bool rasters are bit-packed until they are indexed."""

    data: NDArray[Any]
    raster: Raster

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, rows: Any) -> torch.Tensor:
        """Rasters (k, *raster.shape) of ``rows``; bool as uint8 0 or 1, others in their dtype."""
        return torch.from_numpy(unpack(self.data[rows], self.raster))


def pack(image: NDArray[Any], raster: Raster) -> NDArray[Any]:
    """One raster as flat values, bool as bits in uint8."""
    return np.packbits(image) if raster.dtype == np.bool_ else image.ravel()


def packed_bytes(raster: Raster) -> int:
    """Bytes of one packed raster."""
    values = math.prod(raster.shape)
    return -(-values // 8) if raster.dtype == np.bool_ else values * raster.dtype.itemsize


def unpack(data: NDArray[Any], raster: Raster) -> NDArray[Any]:
    """Rasters (k, *shape) of packed rows (k, m)."""
    if raster.dtype == np.bool_:
        data = np.unpackbits(data, axis=-1, count=int(np.prod(raster.shape)))
    return np.ascontiguousarray(data).reshape(*data.shape[:-1], *raster.shape)
