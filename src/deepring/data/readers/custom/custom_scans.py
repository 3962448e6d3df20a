"""Scans of a custom drive: the sensor's axes turned z up, and what it should not see cropped."""

from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.scan_files import read_scan
from deepring.data.session import Points
from deepring.errors import BrokenScanError

Band = tuple[float, float]

#: Turns (3, 3) that make an axis z, by its name. x stays where it is, or y where x is that axis;
#: for -z both y and z change sign, since z alone would mirror the world.
UP: dict[str, NDArray[np.float64]] = {
    name: np.array(rows, dtype=np.float64)
    for name, rows in {
        "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    }.items()
}


@dataclass(frozen=True)
class CustomScans:
    """Reads scan files, turns them z up and crops them.

    Plain values, all of which make what is read: see ``decoding``. ``format`` says what .bin
    files hold; ``up`` names the sensor's axis that points up; ``sensor_height`` is in metres above
    the ground. Of points z up, those outside ``z_band`` (metres above the ground), ``azimuth``
    (degrees counter-clockwise from x, at most 360 wide) and ``range`` (metres from the sensor) are
    dropped; None drops none.
    """

    format: str | None
    up: str
    sensor_height: float
    z_band: Band | None = None
    azimuth: Band | None = None
    range: Band | None = None

    @property
    def decoding(self) -> str:
        """Names what is made of a file, for `Session.decoding`."""
        return f"custom {astuple(self)}"

    def __call__(self, path: Path) -> Points:
        """Points (m, 3) float32, metres, z up.

        Missing returns, which are (0, 0, 0), NaN or infinite, are dropped. Raises BrokenScanError
        for a file that cannot be decoded, or of which no point is left.
        """
        points = read_scan(path, self.format)
        valid = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
        turned = valid @ UP[self.up].T.astype(np.float32)
        inside = turned[self._inside(turned)]
        if not len(inside):
            raise BrokenScanError(
                f"{path}: {len(points)} points, {len(valid)} of them returns, and none of these "
                "within z_band, azimuth and range; check the file and these keys"
            )
        return np.ascontiguousarray(inside)

    def _inside(self, points: Points) -> NDArray[np.bool_]:
        x, y, z = points.T.astype(np.float64)
        inside = np.ones(len(points), dtype=np.bool_)
        if self.z_band is not None:
            low, high = self.z_band
            above = z + self.sensor_height
            inside &= (above >= low) & (above <= high)
        if self.range is not None:
            low, high = self.range
            distance = np.sqrt(x**2 + y**2 + z**2)
            inside &= (distance >= low) & (distance <= high)
        if self.azimuth is not None:
            low, high = self.azimuth
            # Counted from the lower end, so that 180° is an angle like any other.
            inside &= (np.degrees(np.arctan2(y, x)) - low) % 360 <= high - low
        return inside
