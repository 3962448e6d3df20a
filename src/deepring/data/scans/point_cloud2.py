"""Points of ROS 1 and ROS 2 messages of type sensor_msgs/PointCloud2."""

from collections.abc import Collection, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.errors import BrokenScanError

#: The names of PointField.datatype.
_NAMES = {
    1: "INT8",
    2: "UINT8",
    3: "INT16",
    4: "UINT16",
    5: "INT32",
    6: "UINT32",
    7: "FLOAT32",
    8: "FLOAT64",
}
#: Bytes of a point; NumPy takes no more than 2 GB.
_LARGEST_STEP = 1 << 20
#: NumPy types of those that coordinates may have.
_FLOATS = {7: "f4", 8: "f8"}
#: NumPy types of all.
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", **_FLOATS}


def cloud_records(message: Any) -> NDArray[np.float32]:
    """x, y, z (n, 3) float32, row by row, in the unit of the message: metres by ROS's convention.

    Missing returns are among them (see `is_return`); what is beyond float32 becomes infinite.

    Args:
        message: an object with the fields of sensor_msgs/PointCloud2, ``data`` as uint8.

    Raises:
        BrokenScanError: no x, y and z of a floating-point type, or data of another size than the
            message states.
    """
    formats, offsets = _coordinates(message)
    cloud = _view(message, dict(zip("xyz", zip(formats, offsets, strict=True), strict=True)))
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32 becomes infinite
        return np.stack([cloud[name].astype(np.float32).ravel() for name in "xyz"], axis=1)


def cloud_column(message: Any, names: Collection[str]) -> NDArray[Any] | None:
    """The values (n,) of the first field with one of these names, row by row; None without one.

    A field that is no single number within the bytes of a point is none.

    Raises BrokenScanError for data of another size than the message states.
    """
    for field in message.fields:
        form, offset = _NUMBERS.get(field.datatype), int(field.offset)
        if field.name not in names or form is None or field.count not in (0, 1):
            continue
        if 0 <= offset <= int(message.point_step) - int(form[1]):
            order = ">" if message.is_bigendian else "<"
            return _view(message, {"value": (order + form, offset)})["value"].ravel()
    return None


def _view(message: Any, fields: Mapping[str, tuple[str, int]]) -> NDArray[Any]:
    """The fields, name -> NumPy type and first byte, of all points (rows, columns)."""
    step = int(message.point_step)
    rows, columns = int(message.height), int(message.width)
    row = columns * step
    # Some drivers set row_step to 0 for a single row.
    row_step = int(message.row_step) if rows > 1 else max(row, int(message.row_step))
    # A single row has no reason for padding in which more points would fit.
    most = rows * row_step if rows != 1 else row + min(row_step - row, step - 1)
    data = np.asarray(message.data, dtype=np.uint8)
    # The last row may leave its padding out.
    least = (rows - 1) * row_step + row if rows and columns else 0
    if row_step < row or not least <= len(data) <= most:
        raise BrokenScanError(
            f"PointCloud2: {len(data)} bytes in rows of {row_step}; expected {rows} rows of "
            f"{columns} points of {step} bytes"
        )
    formats, offsets = zip(*fields.values(), strict=True)
    layout = np.dtype(
        {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": step}
    )
    if not least:
        return np.empty((0, 0), dtype=layout)
    return np.ndarray((rows, columns), layout, data.data, 0, (row_step, step))


def _coordinates(message: Any) -> tuple[list[str], list[int]]:
    """The NumPy types of x, y and z, and the bytes of a point at which they begin."""
    fields = {field.name: field for field in message.fields if field.name in ("x", "y", "z")}
    names = [field.name for field in message.fields]
    if (
        sorted(name for name in names if name in fields) != ["x", "y", "z"]
        or any(field.datatype not in _FLOATS for field in fields.values())
        # A count of 0 is an old way to write 1.
        or any(field.count not in (0, 1) for field in fields.values())
    ):
        raise BrokenScanError(
            f"PointCloud2: fields {_words(message.fields)}; expected one x, y and z each, of type "
            "7 (FLOAT32) or 8 (FLOAT64)"
        )
    formats = [_FLOATS[fields[name].datatype] for name in "xyz"]
    offsets = [int(fields[name].offset) for name in "xyz"]
    step = int(message.point_step)
    ends = [offset + int(form[1]) for offset, form in zip(offsets, formats, strict=True)]
    spans = sorted(zip(offsets, ends, strict=True))
    if step > _LARGEST_STEP:
        raise BrokenScanError(
            f"PointCloud2: {step} bytes for each point; expected at most {_LARGEST_STEP}"
        )
    if min(offsets) < 0 or max(ends) > step or any(a[1] > b[0] for a, b in pairwise(spans)):
        raise BrokenScanError(
            f"PointCloud2: x, y and z at bytes {', '.join(map(str, offsets))}; expected them one "
            f"beside another within the {step} bytes of a point"
        )
    order = ">" if message.is_bigendian else "<"
    return [order + form for form in formats], offsets


def _words(fields: Any) -> str:
    """The fields with their types, the first twenty."""
    words = [
        f"{str(field.name)[:40]!r} ({field.count} × type {field.datatype}, "
        f"{_NAMES.get(field.datatype, 'unknown')})"
        for field in fields[:20]
    ]
    return ", ".join(words) or "none"
