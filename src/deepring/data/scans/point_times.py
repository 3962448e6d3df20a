"""When each point of a PointCloud2 was measured, as far as its driver says."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.point_cloud2 import cloud_column
from deepring.data.session import Points

#: Names that drivers give the field: Ouster ``t``, Velodyne ``time``, Hesai, RoboSense and Livox
#: ``timestamp``, Livox ``offset_time``.
FIELDS = ("t", "time", "timestamp", "timestamps", "time_stamp", "offset_time")
#: Seconds that a sweep may take: 200 Hz to 1 Hz. Units are a factor of 1000 apart, so that one at
#: most gives such a duration.
SHORTEST, LONGEST = 0.005, 1.0
#: Seconds, milliseconds, microseconds and nanoseconds.
_UNITS = (1.0, 1e-3, 1e-6, 1e-9)
#: Seconds. Larger values are of a clock, smaller ones are after some moment of the sweep.
_CLOCK = 1e6


class TimedPoints(NamedTuple):
    """Points of a scan, and when they were measured."""

    points: Points
    """(n, 3) float32, metres, in the sensor's frame, without missing returns."""
    times: NDArray[np.float64] | None
    """(n,) seconds after the scan's stamp, also below 0; None if it is not known."""


def point_times(message: Any, returns: NDArray[np.bool_], stamp: int) -> NDArray[np.float64] | None:
    """Seconds from the stamp of a message to each of its points.

    Drivers write seconds to nanoseconds, after the header's stamp or of a clock. The unit is the
    one in which the sweep takes `SHORTEST` to `LONGEST`.

    Args:
        message: an object with the fields of sensor_msgs/PointCloud2.
        returns: mask (m,) of its points that count.
        stamp: nanoseconds, of its header.

    Returns:
        (n,) for the n points of the mask; None without a field of `FIELDS`, and where its values
        are no times: in no unit a sweep, or more than `LONGEST` from the stamp.
    """
    column = cloud_column(message, FIELDS)
    if column is None:
        return None
    values = column[returns].astype(np.float64)
    if not len(values) or not np.isfinite(values).all():
        return None
    duration = float(np.ptp(values))
    unit = next((unit for unit in _UNITS if SHORTEST <= duration * unit <= LONGEST), None)
    if unit is None:
        return None
    of_clock = abs(float(values[0])) * unit > _CLOCK
    # As float64 both are exact to 0.3 microseconds: less than a tenth of a millimetre of driving.
    times = (values - stamp / (unit * 1e9)) * unit if of_clock else values * unit
    return times if float(np.abs(times).max()) <= LONGEST else None
