"""A sweep of a LiDAR: what its rays hit, with noise, dropout, rain and motion."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.fan import Fan
from deepring.simulation.ground import Ground
from deepring.simulation.ground_cover import GroundCover
from deepring.simulation.mounting import Sensor
from deepring.simulation.patterns import SWEEP, Hits, Pattern, Revolution, Shots
from deepring.simulation.rain import DROP, through_rain
from deepring.simulation.raycast import GROUND, cast
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import GROUNDS, PointClass, Prisms

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Body poses (n, 4, 4), world <- body, world z up, at seconds (n,) after the start of a sweep.
Motion = Callable[[FloatArray], FloatArray]

_GROUND_REFLECTANCE, _DROP_REFLECTANCE = 0.25, 0.1
#: Ground that is no road. As a hit each has the number before DROP, NOTHING and GROUND, -3 to -1:
#: its place from the end of what is appended to the prisms' properties.
_COVERS = GROUNDS[1:]

_PARTS = 20  # of a sweep in motion, in each of which the sensor stands still


@dataclass(frozen=True, eq=False)
class Sweep:
    """One sweep: C columns of B rays.

    Of a sensor that spins, columns are counter-clockwise from ``phase`` (rad), and beams ascend;
    of another, each column is one ray, in firing order. ``points`` (C, B, 3) are metres in the
    sensor's frame (z up), NaN without a return; ``reflectance`` (C, B) is in [0, 1]; ``labels``
    (C, B) are each a `PointClass`, 0 without a return. ``seconds`` (C,) are from the start of the
    sweep to each column; None if all is measured at once.
    """

    points: FloatArray
    reflectance: FloatArray
    labels: NDArray[np.uint16]
    seconds: FloatArray | None = None

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
    cover: GroundCover | None = None,
) -> Sweep:
    """Sweep the sensor once from ``body_pose`` (4, 4), world <- body, world z up.

    ``phase`` is the azimuth (rad) of column 0 in the sensor's frame. Apart from range noise, and
    drops of rain, every point is on a surface visible from the sensor (see `Pattern` for where
    rays point). ``cover`` tells kinds of ground apart; without it all ground is road.
    """
    pattern = _pattern(sensor, phase, settings, rng)
    everything = np.arange(len(pattern.seconds))
    pose = body_pose @ sensor.mount
    hits = _shoot(pattern, everything, pose, (sensor, prisms, ground), settings, rng)
    return _measured(_covered(hits, pose, cover), sensor, prisms, settings, rng)


def scan_in_motion(
    sensor: Sensor,
    motion: Motion,
    phase: float,
    prisms: Prisms,
    ground: Ground,
    settings: SimulationSettings,
    rng: np.random.Generator,
    cover: GroundCover | None = None,
) -> Sweep:
    """A sweep of a platform that moves: each point in the sensor's frame of its own moment.

    The sensor jumps 20 times during the sweep; from where it stands between, every point is on a
    visible surface, as in `scan`.
    """
    pattern = _pattern(sensor, phase, settings, rng)
    seconds = pattern.seconds
    part = np.minimum((seconds / SWEEP * _PARTS).astype(np.int64), _PARTS - 1)
    poses = motion((np.arange(_PARTS) + 0.5) * SWEEP / _PARTS) @ sensor.mount
    parts, places = [], []
    for k in np.unique(part):
        columns = np.flatnonzero(part == k)
        hits = _shoot(pattern, columns, poses[k], (sensor, prisms, ground), settings, rng)
        parts.append(_covered(hits, poses[k], cover))
        places.append(columns)
    order = np.argsort(np.concatenate(places))
    whole = Hits(*(np.concatenate(values)[order] for values in zip(*parts, strict=True)))
    return _measured(whole, sensor, prisms, settings, rng, seconds)


def _pattern(
    sensor: Sensor, phase: float, settings: SimulationSettings, rng: np.random.Generator
) -> Pattern:
    if sensor.rosette is not None:
        sign = -1.0 if sensor.upside_down else 1.0
        azimuth, elevation = sensor.rosette.shots(SWEEP, rng)
        return Shots(sign * azimuth, sign * elevation)
    columns = settings.azimuths or sensor.columns
    return Revolution(sensor.elevations, phase, columns, clockwise=not sensor.upside_down)


def _shoot(
    pattern: Pattern,
    columns: IntArray,
    pose: FloatArray,
    scene: tuple[Sensor, Prisms, Ground],
    settings: SimulationSettings,
    rng: np.random.Generator,
) -> Hits:
    """What ``columns`` hit from ``pose``, world <- sensor."""
    sensor, prisms, ground = scene

    def caster(fan: Fan) -> tuple[FloatArray, IntArray]:
        farthest = _farthest(sensor, settings)
        distance, hit = cast(fan, pose[:3, 3], prisms, ground, farthest, rng)
        if settings.rain_mm_per_hour > 0:
            return through_rain(fan, distance, hit, settings.rain_mm_per_hour, rng)
        return distance, hit

    return pattern.part(columns, pose, caster)


def _farthest(sensor: Sensor, settings: SimulationSettings) -> float:
    return min(settings.max_range, sensor.range)


def _covered(hits: Hits, pose: FloatArray, cover: GroundCover | None) -> Hits:
    """The hits from ``pose``, world <- sensor, with ground that is no road as in `_COVERS`."""
    if cover is None:
        return hits
    ground = hits.hit == GROUND
    world = hits.points[ground] @ pose[:3, :3].T + pose[:3, 3]
    kinds, codes = cover.kinds(world[:, :2]), np.full(len(world), GROUND)
    for k, kind in enumerate(reversed(_COVERS)):
        codes[kinds == kind] = DROP - 1 - k
    hit = hits.hit.copy()
    hit[ground] = codes
    return hits._replace(hit=hit)


def _measured(
    hits: Hits,
    sensor: Sensor,
    prisms: Prisms,
    settings: SimulationSettings,
    rng: np.random.Generator,
    seconds: FloatArray | None = None,
) -> Sweep:
    """The sweep that the sensor makes of what its rays hit."""
    returns, lost = _noisy(hits.points, sensor, settings, rng)
    returns[lost] = np.nan
    shades = [_DROP_REFLECTANCE, 0.0, _GROUND_REFLECTANCE]
    surface = np.append(prisms.reflectance, [_GROUND_REFLECTANCE] * len(_COVERS) + shades)
    reflectance = surface[hits.hit] + rng.normal(0.0, 0.04, hits.hit.shape)
    others = [*_COVERS, PointClass.OTHER, PointClass.NOTHING, PointClass.ROAD]
    kinds = np.append(prisms.kind, np.array(others, np.uint16))
    labels = np.where(lost, np.uint16(PointClass.NOTHING), kinds[hits.hit])
    return Sweep(returns, np.clip(reflectance, 0.0, 1.0), labels, seconds)


def _noisy(
    points: FloatArray, sensor: Sensor, settings: SimulationSettings, rng: np.random.Generator
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Points with range noise, and a mask of lost returns: close, dropped, in the blind sector."""
    reach = np.sqrt(np.einsum("cbi,cbi->cb", points, points))
    noise = sensor.noise if settings.range_noise is None else settings.range_noise
    noisy = points * (1 + noise * rng.normal(size=reach.shape) / reach)[..., None]
    grow = settings.dropout_far - settings.dropout_near
    dropout = settings.dropout_near + grow * (reach / _farthest(sensor, settings)) ** 2
    lost = rng.random(reach.shape) < dropout
    lost |= reach < sensor.blind
    if settings.blind_width_deg > 0:
        azimuth = np.abs(np.arctan2(points[..., 1], points[..., 0]))
        lost |= azimuth < np.deg2rad(settings.blind_width_deg) / 2
    return noisy, lost
