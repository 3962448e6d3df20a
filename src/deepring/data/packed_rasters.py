"""Rasters of many scans in memory, occupancy as single bits."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.rasters import Raster


@dataclass(frozen=True, eq=False)
class Rasters:
    """Images of n scans in memory; bool images stay bit-packed until they are asked for."""

    data: NDArray[Any]
    raster: Raster

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, rows: Any) -> torch.Tensor:
        """Images (k, *raster.shape) of ``rows``: bool as uint8 0 or 1, others as stored."""
        return torch.from_numpy(unpack(self.data[rows], self.raster))


def pack(image: NDArray[Any], raster: Raster) -> NDArray[Any]:
    """Flat uint8 or raw values of one image, as stored."""
    return np.packbits(image) if raster.dtype == np.bool_ else image.ravel()


def unpack(data: NDArray[Any], raster: Raster) -> NDArray[Any]:
    """Images (k, *shape) of stored rows (k, m)."""
    if raster.dtype == np.bool_:
        data = np.unpackbits(data, axis=-1, count=int(np.prod(raster.shape)))
    return np.ascontiguousarray(data).reshape(*data.shape[:-1], *raster.shape)
