"""Scan patterns: the rays of one sweep in firing columns, and what they hit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import yaw_of
from deepring.simulation.fan import Fan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Seconds of a sweep: all sensors are at 10 Hz.
SWEEP = 0.1

_CIRCLE = 3600  # headings of a rosette's rays are multiples of 0.1°
_ZENITH = 38.0  # slope of rays that fill up columns

#: The horizontal distances and hits of a fan's rays, as `cast` gives them.
Caster = Callable[[Fan], tuple[FloatArray, IntArray]]


class Hits(NamedTuple):
    """What C columns of B rays hit."""

    points: FloatArray
    """(C, B, 3) metres in the sensor's frame, NaN without a hit."""
    hit: IntArray
    """(C, B) as of `cast`."""


class Pattern(Protocol):
    """The rays of a sweep: C columns of B rays."""

    @property
    def seconds(self) -> FloatArray:
        """Seconds (C,) from the start of the sweep to each column."""

    def part(self, columns: IntArray, pose: FloatArray, cast: Caster) -> Hits:
        """What the rays of consecutive ``columns`` hit from ``pose`` (4, 4), world <- sensor."""


@dataclass(frozen=True, eq=False)
class Revolution:
    """Columns counter-clockwise from the azimuth ``phase`` (rad), beams (B,) at ``elevations``.

    With ``clockwise`` the last one fires first, as seen from above. On a tilted sensor elevations
    are exact in the sensor's frame, while azimuths are evenly spaced in the world: in the sensor's
    frame they differ from an even spacing by the tilt times the tangent of the elevation.
    """

    elevations: FloatArray
    phase: float
    columns: int
    clockwise: bool

    @property
    def seconds(self) -> FloatArray:
        """Seconds (C,) from the start of the sweep to each column."""
        order: FloatArray = SWEEP / self.columns * np.arange(self.columns, dtype=np.float64)
        return order[::-1] if self.clockwise else order

    def part(self, columns: IntArray, pose: FloatArray, cast: Caster) -> Hits:
        """What the rays of consecutive ``columns`` hit from ``pose``."""
        fan = self._fan(columns, pose)
        distance, hit = cast(fan)
        return Hits(_in_sensor_frame(fan.headings[:, None], fan.slopes, distance, pose), hit)

    def _fan(self, columns: IntArray, pose: FloatArray) -> Fan:
        """World slopes of the beams.

        A world direction of heading h and elevation ε has the sensor elevation e with
        sin e = (a cos h + b sin h) cos ε + c sin ε, where (a, b, c) is the sensor's z axis.
        """
        step = 2 * np.pi / self.columns
        first = float(yaw_of(pose)) + self.phase
        heading = first + step * columns
        a, b, c = pose[:3, 2]
        lean = a * np.cos(heading) + b * np.sin(heading)
        size = np.hypot(lean, c)[:, None]
        elevation = np.arcsin(np.sin(self.elevations) / size) - np.arctan2(lean, c)[:, None]
        return Fan(first + step * int(columns[0]), np.tan(elevation), self.columns)


@dataclass(frozen=True, eq=False)
class Shots:
    """Single rays in firing order, azimuth and elevation (n,) in the sensor's frame (rad).

    World headings are rounded to 0.1°, so that rays share columns.
    """

    azimuth: FloatArray
    elevation: FloatArray

    @property
    def seconds(self) -> FloatArray:
        """Seconds (n,) from the start of the sweep to each ray."""
        return np.linspace(0.0, SWEEP, len(self.azimuth), endpoint=False)

    def part(self, columns: IntArray, pose: FloatArray, cast: Caster) -> Hits:
        """What the rays ``columns`` hit from ``pose``."""
        azimuth, elevation = self.azimuth[columns], self.elevation[columns]
        level = np.cos(elevation)
        aim = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        x, y, z = pose[:3, :3] @ aim
        step = 2 * np.pi / _CIRCLE
        ahead = np.arctan2(pose[1, 0], pose[0, 0])
        turn = np.arctan2(y, x) - ahead
        bin = np.round((turn - 2 * np.pi * np.round(turn / (2 * np.pi))) / step).astype(np.int64)
        column, slope = bin - bin.min(), z / np.hypot(x, y)
        first = float(ahead + step * bin.min())
        place, slopes = _in_columns(column, slope)
        distance, hit = (values[column, place] for values in cast(Fan(first, slopes, _CIRCLE)))
        points = _in_sensor_frame(first + step * column, slope, distance, pose)
        return Hits(points[:, None], hit[:, None])


def _in_columns(column: IntArray, slope: FloatArray) -> tuple[IntArray, FloatArray]:
    """Places (n,) of rays in their columns, and slopes (C, B), ascending, filled up at the end."""
    order = np.lexsort((slope, column))
    counts = np.bincount(column)
    before = np.cumsum(counts) - counts
    place = np.empty_like(column)
    place[order] = np.arange(len(order)) - before[column[order]]
    slopes = np.full((len(counts), int(counts.max())), _ZENITH)
    slopes[column, place] = slope
    return place, slopes


def _in_sensor_frame(
    heading: FloatArray, slope: FloatArray, distance: FloatArray, pose: FloatArray
) -> FloatArray:
    """Points (..., 3) in the sensor's frame, NaN without a hit."""
    reach = np.where(np.isfinite(distance), distance, np.nan)
    c, s = np.cos(heading), np.sin(heading)
    world = np.stack([reach * c, reach * s, reach * slope], axis=-1)
    turned: FloatArray = world @ pose[:3, :3]
    return turned
