"""A sweep of a spinning LiDAR: scan pattern, noise and dropout."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import yaw_of
from deepring.simulation.ground import Ground
from deepring.simulation.mounting import Sensor
from deepring.simulation.raycast import Fan, cast
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import PointClass, Prisms

FloatArray = NDArray[np.float64]

_GROUND_REFLECTANCE = 0.25


@dataclass(frozen=True, eq=False)
class Sweep:
    """One revolution: C columns, counter-clockwise from ``phase`` (rad), of B beams, ascending.

    ``points`` (C, B, 3) are metres in the sensor's frame (z up), NaN without a return;
    ``reflectance`` (C, B) is in [0, 1]; ``labels`` (C, B) are each a `PointClass`, 0 without a
    return.
    """

    points: FloatArray
    reflectance: FloatArray
    labels: NDArray[np.uint16]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask (C, B) of the rays with a return."""
        finite: NDArray[np.bool_] = np.isfinite(self.points[..., 0])
        return finite


def scan(
    sensor: Sensor,
    body_pose: FloatArray,
    phase: float,
    prisms: Prisms,
    ground: Ground,
    settings: SimulationSettings,
    rng: np.random.Generator,
) -> Sweep:
    """Sweep the sensor once from ``body_pose`` (4, 4), world <- body, world z up.

    ``phase`` is the azimuth (rad) of column 0 in the sensor's frame. Apart from range noise, every
    point is on a surface visible from the sensor. On a tilted platform beam elevations are exact
    in the sensor's frame, while azimuths are evenly spaced in the world: in the sensor's frame
    they differ from an even spacing by the tilt times the tangent of the elevation.
    """
    pose = body_pose @ sensor.mount
    fan = _fan(sensor.elevations, pose, phase, settings.azimuths or sensor.columns)
    farthest = min(settings.max_range, sensor.range)
    distance, hit = cast(fan, pose[:3, 3], prisms, ground, farthest, rng)
    points = _in_sensor_frame(fan, distance, pose)
    returns, lost = _measure(points, sensor, settings, rng)
    returns[lost] = np.nan
    surface = np.append(prisms.reflectance, [0.0, _GROUND_REFLECTANCE])  # NOTHING, GROUND
    reflectance = surface[hit] + rng.normal(0.0, 0.04, hit.shape)
    kinds = np.append(prisms.kind, np.array([PointClass.NOTHING, PointClass.GROUND], np.uint16))
    labels = np.where(lost, np.uint16(PointClass.NOTHING), kinds[hit])
    return Sweep(returns, np.clip(reflectance, 0.0, 1.0), labels)


def _fan(elevations: FloatArray, pose: FloatArray, phase: float, columns: int) -> Fan:
    """World slopes of the beams whose elevation in the sensor's frame is ``elevations``.

    A world direction of heading h and elevation ε has the sensor elevation e with
    sin e = (a cos h + b sin h) cos ε + c sin ε, where (a, b, c) is the sensor's z axis.
    """
    first = float(yaw_of(pose)) + phase
    heading = first + 2 * np.pi / columns * np.arange(columns)
    a, b, c = pose[:3, 2]
    lean = a * np.cos(heading) + b * np.sin(heading)
    size = np.hypot(lean, c)[:, None]
    elevation = np.arcsin(np.sin(elevations) / size) - np.arctan2(lean, c)[:, None]
    return Fan(first, np.tan(elevation))


def _in_sensor_frame(fan: Fan, distance: FloatArray, pose: FloatArray) -> FloatArray:
    """Hits (C, B, 3) in the sensor's frame, NaN without a hit."""
    reach = np.where(np.isfinite(distance), distance, np.nan)
    c, s = np.cos(fan.headings)[:, None], np.sin(fan.headings)[:, None]
    world = np.stack([reach * c, reach * s, reach * fan.slopes], axis=-1)
    return world @ pose[:3, :3]


def _measure(
    points: FloatArray, sensor: Sensor, settings: SimulationSettings, rng: np.random.Generator
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Points with range noise, and a mask of lost returns: close, dropped, in the blind sector."""
    reach = np.sqrt(np.einsum("cbi,cbi->cb", points, points))
    noise = sensor.noise if settings.range_noise is None else settings.range_noise
    noisy = points * (1 + noise * rng.normal(size=reach.shape) / reach)[..., None]
    grow = settings.dropout_far - settings.dropout_near
    farthest = min(settings.max_range, sensor.range)
    dropout = settings.dropout_near + grow * (reach / farthest) ** 2
    lost = rng.random(reach.shape) < dropout
    lost |= reach < sensor.blind
    if settings.blind_width_deg > 0:
        azimuth = np.abs(np.arctan2(points[..., 1], points[..., 0]))
        lost |= azimuth < np.deg2rad(settings.blind_width_deg) / 2
    return noisy, lost
