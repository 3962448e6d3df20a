"""Why nothing of a scan is to be seen in its raster."""

import numpy as np
from numpy.typing import NDArray

from deepring.rasters.preprocessing import Preprocessing

#: Largest spread of a scan's points around their middle, metres; with a larger one they are in
#: another unit.
SPREAD = 500.0

#: Largest distance of a scan's points from the sensor, metres, in units that are too large.
TINY = 3.0


def blank_reason(
    points: NDArray[np.floating], ground_z: float, preprocessing: Preprocessing
) -> str:
    """Why nothing or little of a scan stands out: its extent, what is in range, and what to do.

    Args:
        points: (n, >=3) metres in the scan's frame, finite.
        ground_z: z of the ground under the sensor in that frame, metres.
        preprocessing: the crop that left nothing.

    >>> points = np.array([[345000.0, 4037000.0, 12.0], [345010.0, 4037010.0, 14.0]])
    >>> print(blank_reason(points, -1.7, Preprocessing()))
    2 points, 0 of them within 70 m: x 345000 to 345010, y 4037000 to 4037010, z 12 to 14 m; these \
look like world coordinates, expected metres from the sensor
    """
    xyz = np.asarray(points[:, :3], dtype=np.float64)
    extent, (low, high) = preprocessing.extent, preprocessing.height
    near = xyz[np.abs(xyz[:, :2]).max(axis=1, initial=0.0) < extent]
    what = f"{len(xyz)} points, {len(near)} of them within {extent:g} m: {_ranges(xyz)}"
    if len(near) < 0.01 * len(xyz):
        return f"{what}; {_far(xyz, extent)}"
    if len(xyz) > 1 and np.abs(xyz).max() < TINY:
        return (
            f"{what}; all lie within {np.abs(xyz).max():.2g} m, expected metres; check the unit, "
            "and that they are not scaled to [-1, 1]"
        )
    band = (near[:, 2] > low + ground_z) & (near[:, 2] < high + ground_z)
    if band.sum() < 0.01 * len(near):
        return (
            f"{what}; {int(band.sum())} of those within range have z from {low + ground_z:g} to "
            f"{high + ground_z:g} m, {-low:g} m below to {high:g} m above the ground at "
            f"ground_z = {ground_z:g} m; the lowest of them are at {_lowest(near):.1f} m: set "
            "`ground_z` to z of the ground, and check that z points up"
        )
    clearance = preprocessing.clearance or 0.0
    return (
        f"{what}, the ground at {_lowest(near):.1f} m; nothing or little is more than "
        f"{clearance:g} m above the ground around it: expected walls, trunks or other things "
        "that stand there"
    )


def _far(xyz: NDArray[np.float64], extent: float) -> str:
    middle = np.median(xyz[:, :2], axis=0)
    spread = float(np.quantile(np.linalg.norm(xyz[:, :2] - middle, axis=1), 0.9))
    if spread > SPREAD:
        return "these look like millimetres or centimetres, expected metres"
    if np.linalg.norm(middle) > extent:
        return "these look like world coordinates, expected metres from the sensor"
    return "expected points nearer to the sensor"


def _lowest(xyz: NDArray[np.float64]) -> float:
    """Where the ground seems to be, metres: a low quantile is safe from single points below it."""
    return float(np.quantile(xyz[:, 2], 0.02))


def _ranges(xyz: NDArray[np.float64]) -> str:
    ends = zip("xyz", xyz.min(axis=0), xyz.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.7g} to {high:.7g}" for axis, low, high in ends) + " m"
