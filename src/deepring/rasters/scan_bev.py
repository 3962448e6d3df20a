"""From a raw scan to its bird's-eye image in one go: what most of the time of a scan goes into."""

import numpy as np
from numpy.typing import NDArray

from deepring.rasters.bev import disc_mask
from deepring.rasters.preprocessing import Preprocessing, coordinates, expect_points


def scan_to_bev(
    points: NDArray[np.float32],
    ground_z: float,
    preprocessing: Preprocessing,
    extent: float = 70.0,
    cells: int = 120,
) -> NDArray[np.bool_]:
    """``bev_occupancy(preprocessing(points, ground_z), extent, cells)``, several times faster.

    No points are copied; each is given its cell, and cells are marked. (cells, cells) bool.
    """
    from deepring.rasters import _bev_kernels as _kernels

    flat = coordinates(expect_points(points))
    low, high = (height + ground_z for height in preprocessing.height)
    box = preprocessing.extent
    image = np.zeros(cells * cells + 1, dtype=np.uint8)  # the last cell is for all other points
    if preprocessing.clearance is None:
        _kernels.band_occupancy(flat, box, low, high, extent, cells, image)
    else:
        side = preprocessing.side
        of_ground, of_image = np.empty((2, len(points)), dtype=np.uint32)
        _kernels.two_cells(
            flat, box, low, high, preprocessing.cell, side, extent, cells, of_ground, of_image
        )
        floor = preprocessing.floor(flat, of_ground)
        clearance = np.float32(preprocessing.clearance)
        _kernels.mark_above(flat, of_ground, of_image, floor, clearance, image)
    occupied = image[:-1].reshape(cells, cells).view(np.bool_)
    occupied &= disc_mask(cells)
    return occupied
