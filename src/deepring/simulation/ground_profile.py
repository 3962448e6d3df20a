"""Where beams meet the ground, by the profile of its slopes along each azimuth."""

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.fan import Fan
from deepring.simulation.ground import Ground

FloatArray = NDArray[np.float64]

_GROUND_RINGS = 48  # radii at which the ground's profile is sampled
_GROUND_STRIDE = 4  # the profile is computed for every fourth azimuth and interpolated between


def ground_distance(fan: Fan, origin: FloatArray, ground: Ground, max_range: float) -> FloatArray:
    """Horizontal distance (C, B) at which each beam meets the ground, or inf.

    The profile is the running maximum of the ground's slopes from the origin, so that a crest
    hides the ground behind it; a beam meets the ground where the profile reaches its slope.
    """
    columns = len(fan.slopes)
    radii = np.concatenate([[0.0], np.geomspace(0.8, max_range, _GROUND_RINGS)])
    # One more behind the end of a sector; a whole circle ends at its beginning.
    count = -(-columns // _GROUND_STRIDE) + (not fan.whole)
    coarse = fan.first + fan.step * np.arange(0.0, count * _GROUND_STRIDE, _GROUND_STRIDE)
    heights = ground.height(
        origin[0] + np.cos(coarse)[:, None] * radii, origin[1] + np.sin(coarse)[:, None] * radii
    )
    slopes = np.full(heights.shape, -20.0)  # steeper than any beam, below the sensor
    slopes[:, 1:] = (heights[:, 1:] - origin[2]) / radii[1:]
    profile = np.maximum.accumulate(_between(slopes, fan), axis=1)

    # One sorted search for all columns, each lifted above the previous one.
    lift = 100.0 * np.arange(columns)[:, None]
    place = np.searchsorted((profile + lift).ravel(), (fan.slopes + lift).ravel())
    ring = place.reshape(fan.slopes.shape) - profile.shape[1] * np.arange(columns)[:, None]
    meets = ring < len(radii)
    ring = np.clip(ring, 1, len(radii) - 1)
    before = np.take_along_axis(profile, ring - 1, axis=1)
    after = np.take_along_axis(profile, ring, axis=1)
    # Between two radii the ground is a straight line, and the height above it decreases linearly.
    above = (fan.slopes - before) * radii[ring - 1]
    below = (after - fan.slopes) * radii[ring]
    above = np.where(ring == 1, _height_above(origin, ground), above)
    share = above / np.maximum(above + below, 1e-12)
    distance = radii[ring - 1] + share * (radii[ring] - radii[ring - 1])
    return np.where(meets, distance, np.inf)


def _height_above(origin: FloatArray, ground: Ground) -> float:
    return float(origin[2] - ground.height(origin[0], origin[1]))


def _between(coarse: FloatArray, fan: Fan) -> FloatArray:
    """Rows (C, n) interpolated between the rows of every ``_GROUND_STRIDE``-th column."""
    columns = len(fan.slopes)
    index = np.arange(columns)
    left = index // _GROUND_STRIDE
    right = (left + 1) % len(coarse)
    room = columns - left * _GROUND_STRIDE if fan.whole else _GROUND_STRIDE
    share = ((index % _GROUND_STRIDE) / np.minimum(_GROUND_STRIDE, room))[:, None]
    return (1 - share) * coarse[left] + share * coarse[right]
