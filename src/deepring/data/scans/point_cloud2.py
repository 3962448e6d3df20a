"""Points of ROS 1 and ROS 2 messages of type sensor_msgs/PointCloud2."""

from typing import Any

import numpy as np

from deepring.data.scans.returns import is_return
from deepring.data.session import Points
from deepring.errors import BrokenScanError

#: NumPy types of the values of PointField.datatype that coordinates may have.
_FLOATS = {7: "f4", 8: "f8"}


def cloud_points(message: Any) -> Points:
    """Points (n, 3) float32, row by row, in the unit of the message: metres by ROS's convention.

    Drops missing returns; see `is_return`.

    Args:
        message: an object with the fields of sensor_msgs/PointCloud2, ``data`` as uint8.

    Raises:
        BrokenScanError: no x, y and z of a floating-point type, or too few bytes.
    """
    layout = _layout(message)
    rows, columns = int(message.height), int(message.width)
    if not rows * columns:
        return np.empty((0, 3), dtype=np.float32)
    row = columns * layout.itemsize
    # Some drivers set row_step to 0 for a single row.
    row_step = int(message.row_step) if rows > 1 else row
    data = np.asarray(message.data, dtype=np.uint8)
    if row_step < row or len(data) < (rows - 1) * row_step + row:
        raise BrokenScanError(
            f"PointCloud2: {len(data)} bytes in rows of {row_step}; expected {rows} rows of "
            f"{columns} points of {layout.itemsize} bytes"
        )
    cloud = np.ndarray((rows, columns), layout, data.data, 0, (row_step, layout.itemsize))
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32 becomes infinite
        points = np.stack([cloud[name].astype(np.float32).ravel() for name in "xyz"], axis=1)
    return points[is_return(points)]


def _layout(message: Any) -> np.dtype[np.void]:
    """The NumPy type of a point, with x, y and z at their offsets."""
    fields = {field.name: field for field in message.fields}
    if any(name not in fields or fields[name].datatype not in _FLOATS for name in "xyz"):
        names = ", ".join(f"{name} (type {field.datatype})" for name, field in fields.items())
        raise BrokenScanError(
            f"PointCloud2: fields {names or 'none'}; expected x, y and z of type 7 (float32) or 8 "
            "(float64)"
        )
    order = ">" if message.is_bigendian else "<"
    try:
        return np.dtype(
            {
                "names": list("xyz"),
                "formats": [order + _FLOATS[fields[name].datatype] for name in "xyz"],
                "offsets": [int(fields[name].offset) for name in "xyz"],
                "itemsize": int(message.point_step),
            }
        )
    except ValueError as error:
        offsets = ", ".join(str(fields[name].offset) for name in "xyz")
        raise BrokenScanError(
            f"PointCloud2: x, y and z at bytes {offsets}; expected them within the "
            f"{message.point_step} bytes of a point"
        ) from error
