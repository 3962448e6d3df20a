"""Checks of what a caller gives a map, before anything of the map changes."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.core.arrays import real_array
from deepring.errors import ConfigError, DataError


def given_list(name: str, values: Any, what: str) -> list[Any]:
    """The values as a list, also those of a generator. Raises DataError for anything else."""
    try:
        each = None if isinstance(values, str | bytes) else iter(values)
    except TypeError:  # also of arrays without axes
        each = None
    if each is None:
        raise DataError(f"{name}: a {type(values).__name__}, expected a list of {what}")
    return list(each)


def given_names(names: Any, count: int) -> list[str]:
    """One name for each of ``count`` scans. Raises DataError for anything else."""
    names = given_list("names", names, "texts, one for each scan")
    for name in names:
        if not isinstance(name, str):
            raise DataError(f"names: a {type(name).__name__}, expected texts")
    if len(names) != count:
        raise DataError(f"names: {len(names)}, expected {count}, one for each scan")
    return [str(name) for name in names]


def given_path(path: Any) -> Path:
    """The path of a file. Raises ConfigError for what names none."""
    if not isinstance(path, str | Path) or "\0" in str(path) or not Path(path).name:
        raise ConfigError(f"path: {path!r}, expected the path of a file")
    return Path(path)


def given_poses(poses: Any, count: int) -> NDArray[np.float64]:
    """One rigid pose (4, 4) for each of ``count`` scans: (count, 4, 4).

    Raises DataError for other shapes, and for poses that are not finite or not rigid to within 1 %.
    """
    array = real_array("poses", poses)
    if array.shape != (count, 4, 4):
        raise DataError(
            f"poses: shape {array.shape}, expected ({count}, 4, 4), a world <- scan transform for "
            "each scan, the last row of each 0, 0, 0, 1"
        )
    with np.errstate(over="ignore"):
        array = array.astype(np.float64)
    for k in np.flatnonzero(~np.isfinite(array).all(axis=(1, 2))):
        raise DataError(f"poses: pose {k} is not finite, expected world <- scan transforms")
    rigid = nearly_rigid(array) & (np.abs(array[:, 3] - [0, 0, 0, 1]) < 1e-6).all(axis=1)
    for k in np.flatnonzero(~rigid):
        raise DataError(
            f"poses: pose {k} is not rigid, expected a rotation and a shift, and 0, 0, 0, 1 below"
        )
    array[:, 3] = [0, 0, 0, 1]
    return array


def nearly_rigid(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask (n,) of the poses (n, 4, 4) whose rotations are rotations to within 1 %.

    Readers ask more (`deepring.data.poses.rigid`), but know how many decimals their files have; in
    products with the pose of a sensor that cannot be seen.
    """
    rotations = np.clip(np.nan_to_num(poses[:, :3, :3]), -2.0, 2.0)
    off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    return np.asarray((off < 0.01) & (np.linalg.det(rotations) > 0), dtype=np.bool_)
