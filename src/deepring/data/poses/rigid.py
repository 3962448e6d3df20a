"""Whether matrices are poses: a rotation, within the digits that are given, and a shift."""

import numpy as np
from numpy.typing import NDArray

#: Entries of R Rᵀ may differ from the identity by so much, whatever the digits: chains of products
#: in single precision drift by up to 1e-4.
FLOOR = 5e-4
#: Numbers of decimals at which rounding is more than `FLOOR`; fewer are taken for the first.
_DECIMALS = (2, 3, 4)


def rigid_rows(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask (n,) of the poses (n, 4, 4) that are finite and have a rotation.

    A rotation may be off by what rounding explains: half a unit of the last decimal that the
    rotations of the file have, but no scale, shear or reflection beyond.
    """
    finite = np.isfinite(poses).all(axis=(1, 2))
    # Clipping prevents overflow in the product; entries of rotations are at most 1.
    rotations = np.clip(np.nan_to_num(poses[:, :3, :3]), -2.0, 2.0)
    product = np.einsum("nij,nkj->nik", rotations, rotations)
    sums = np.abs(rotations).sum(axis=2)
    half = rounding(rotations[finite].reshape(-1, 9))
    # With each entry off by up to h, r_i·r_j is off by up to h (|r_i| + |r_j|) + 3 h².
    allowed = FLOOR + half * (sums[:, :, None] + sums[:, None, :]) + 3 * half**2
    orthonormal = (np.abs(product - np.eye(3)) <= allowed).all(axis=(1, 2))
    # A reflection is orthonormal too: the third row must be the cross product of the others.
    third = np.cross(rotations[:, 0], rotations[:, 1])
    proper = np.einsum("ni,ni->n", third, rotations[:, 2]) > 0
    return np.asarray(finite & orthonormal & proper, dtype=np.bool_)


def unit_rows(quaternions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask (n,) of the quaternions (n, 4) of length 1, to within rounding as in `rigid_rows`."""
    finite = np.isfinite(quaternions).all(axis=1)
    values = np.clip(np.nan_to_num(quaternions), -2.0, 2.0)
    half = rounding(values[finite])
    allowed = FLOOR + 2 * half * np.abs(values).sum(axis=1) + 4 * half**2
    return np.asarray(finite & (np.abs((values**2).sum(axis=1) - 1) <= allowed), dtype=np.bool_)


def rounding(rows: NDArray[np.float64]) -> float:
    """Half a unit of the last decimal in which rows (n, k) are given; 0 for more than four."""
    # Small entries may have more decimals, where all have the same number of digits.
    large = rows[np.abs(rows) >= 0.1]
    for decimals in _DECIMALS:
        if (np.round(large, decimals) == large).all():
            return 0.5 * 10.0**-decimals
    return 0.0


def rotation_problem(pose: NDArray[np.float64]) -> str:
    """Why a pose (4, 4) is none of `rigid_rows`, for messages."""
    rotation = pose[:3, :3]
    if not np.isfinite(pose).all():
        return "it holds numbers that are not finite"
    if np.abs(pose[:3, 3]).max() >= 1e12:
        return f"its position is {_list(pose[:3, 3])}"
    lengths = np.linalg.norm(np.clip(rotation, -1e150, 1e150), axis=1)
    if np.abs(lengths - 1).max() > FLOOR:
        return f"the rows of its rotation have lengths {_list(lengths)}, expected 1"
    if np.linalg.det(rotation) < 0:
        return "its rotation mirrors"
    return "the rows of its rotation are not at right angles"


def _list(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)
