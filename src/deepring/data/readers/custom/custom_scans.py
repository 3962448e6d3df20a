"""Scans of a custom dataset, rotated z up and cropped."""

from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.columns import label_path
from deepring.data.scans.labels import read_labels
from deepring.data.scans.returns import is_return, scan_from
from deepring.data.scans.scan_files import scan_records
from deepring.data.session import Points
from deepring.errors import BrokenScanError

Band = tuple[float, float]

#: Rotations (3, 3) of an axis to z, by its name. x does not change, or y if x is that axis; for -z
#: both y and z change sign, since a change of z alone would mirror the world.
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
    """Reads scan files, rotates them z up and crops them.

    ``format`` is that of .bin files; ``up`` is the sensor's axis that points up;
    ``sensor_height`` is in metres above the ground. Then points outside ``z_band`` (metres above
    the ground), ``azimuth`` (degrees counter-clockwise from x, at most 360 wide) or ``range``
    (metres from the sensor) are dropped; None drops none.
    """

    format: str | None
    up: str
    sensor_height: float
    z_band: Band | None = None
    azimuth: Band | None = None
    range: Band | None = None

    @property
    def decoding(self) -> str:
        """Name of the decoding, for `Session`."""
        return f"custom, whole files {astuple(self)}"

    def __call__(self, path: Path) -> Points:
        """Points (m, 3) float32, metres, z up.

        Missing returns are included, as NaN. Raises BrokenScanError for a file that cannot be
        decoded, or if no point is left.
        """
        points, missing = scan_from(scan_records(path, self.format), path)
        upright = points @ UP[self.up].T.astype(np.float32)
        inside = upright[self._inside(upright)]
        if not len(inside):
            raise BrokenScanError(
                f"{path}: {len(points)} points, none within z_band, azimuth and range; check the "
                "file and these keys"
            )
        return np.concatenate([inside, np.full((missing, 3), np.nan, dtype=np.float32)])

    def labels(self, path: Path) -> NDArray[np.uint16]:
        """The classes (m,) of the points that a call gives; 0 for missing returns.

        Raises BrokenScanError as `read_labels`, and for another number of labels than the file has
        points.
        """
        records, labels = scan_records(path, self.format), read_labels(path)
        if len(labels) != len(records):
            raise BrokenScanError(
                f"{label_path(path)}: {len(labels)} labels for the {len(records)} points of "
                f"{path.name}; expected one for each"
            )
        returns = is_return(records)
        upright = records[returns] @ UP[self.up].T.astype(np.float32)
        inside = labels[returns][self._inside(upright)]
        missing = len(records) - int(np.count_nonzero(returns))
        return np.concatenate([inside, np.zeros(missing, dtype=np.uint16)])

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
            # Counted from the lower end, so that intervals may cross 180°.
            inside &= (np.degrees(np.arctan2(y, x)) - low) % 360 <= high - low
        return inside
