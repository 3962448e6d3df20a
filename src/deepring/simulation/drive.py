"""A drive: poses at any time, times of scans, and ground-truth rows."""

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.simulation.ground import Ground
from deepring.simulation.mounting import sensor_of
from deepring.simulation.routes import Route, database_route, query_route
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.streets import Streets
from deepring.simulation.world import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STEP = 0.5  # metres between the samples of a path
_ROUNDING = 3.0  # corners are rounded over about twice this (metres)
_YAW_SMOOTHING = 1.5  # the yaw is smoothed by a Gaussian of this deviation (metres)
_SWAYS = 4  # sine waves in the roll of the platform, and in its pitch
_WARM_UP = 0.5  # seconds of poses before the first scan and after the last

#: Start times of the sessions, in years without real recordings.
_STARTS = [datetime(2031, 2, 4, 15, tzinfo=UTC), datetime(2031, 3, 17, 18, tzinfo=UTC)]


@dataclass(frozen=True, eq=False)
class DrivenPath:
    """Samples of a smooth path: path length (n,), x and y (n,), unwrapped yaw (n,)."""

    driven: FloatArray
    x: FloatArray
    y: FloatArray
    yaw: FloatArray


@dataclass(frozen=True, eq=False)
class Sway:
    """An angle over time (rad): a sum of sines; each array is (waves,)."""

    amplitude: FloatArray
    frequency: FloatArray  # rad/s
    phase: FloatArray

    def at(self, seconds: FloatArray) -> FloatArray:
        """The angle (rad) at each of ``seconds`` (n,)."""
        waves = np.sin(seconds[:, None] * self.frequency + self.phase)
        angle: FloatArray = waves @ self.amplitude
        return angle


@dataclass(frozen=True, eq=False)
class Drive:
    """One session's motion. Stamps are microseconds (int64); poses world <- body, z up.

    ``scan_stamps`` (n,) are between rows of ``pose_stamps`` (m,), never equal to one.
    """

    path: DrivenPath
    roll: Sway
    pitch: Sway
    ground: Ground
    body_height: float
    speed: float
    start: int
    scan_stamps: IntArray
    pose_stamps: IntArray

    def poses(self, stamps: IntArray) -> FloatArray:
        """Body poses (n, 4, 4) at ``stamps``, constant before the start and after the end."""
        seconds = (stamps - self.start).astype(np.float64) * 1e-6
        driven = seconds * self.speed
        x = np.interp(driven, self.path.driven, self.path.x)
        y = np.interp(driven, self.path.driven, self.path.y)
        z = self.ground.height(x, y) + self.body_height
        yaw = np.interp(driven, self.path.driven, self.path.yaw)
        rotation = rotation_from_rpy(self.roll.at(seconds), self.pitch.at(seconds), yaw)
        return pose_from(rotation, np.stack([x, y, z], axis=1))


def plan_drives(world: World, settings: SimulationSettings) -> tuple[Drive, Drive]:
    """The drives of database and query through ``world``, along the same streets."""
    rng = np.random.default_rng([settings.seed, 3])
    parts = database_route(world.streets, rng)
    first = parts[0] + parts[1]
    second: Route = []
    for part in parts:
        second += query_route(part, settings.reversed_share, rng)
    database, query = (
        _drive(route, world, session, settings, rng)
        for session, route in enumerate((first, second))
    )
    return database, query


def _drive(
    route: Route,
    world: World,
    session: int,
    settings: SimulationSettings,
    rng: np.random.Generator,
) -> Drive:
    path = _path(route, world.streets, settings, rng)
    start = int(_STARTS[session].timestamp()) * 1_000_000
    period = 1_000_000 // settings.pose_rate
    scan_stamps = start + _scan_times(path, period, settings, rng)
    warm_up = round(_WARM_UP * settings.pose_rate) * period
    pose_stamps = np.arange(start - warm_up, scan_stamps[-1] + warm_up, period, dtype=np.int64)
    return Drive(
        path=path,
        roll=_sway(settings.tilt_deg, rng),
        pitch=_sway(settings.tilt_deg, rng),
        ground=world.ground,
        body_height=sensor_of(settings, session).body_height,
        speed=settings.speed,
        start=start,
        scan_stamps=scan_stamps,
        pose_stamps=pose_stamps,
    )


def _path(
    route: Route, streets: Streets, settings: SimulationSettings, rng: np.random.Generator
) -> DrivenPath:
    """Follow the streets with a varying sideways offset and rounded corners."""
    corners = streets.crossings[route]
    legs = np.diff(corners, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    driven = np.arange(0.0, ends[-1], _STEP)
    leg = np.searchsorted(ends, driven, side="right") - 1
    along = legs[leg] / lengths[leg, None]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    aside = _wander(driven, settings, rng) - settings.lane_offset
    points = corners[leg] + (driven - ends[leg])[:, None] * along + aside[:, None] * left
    return _evenly_sampled(_smooth(points, _ROUNDING))


def _evenly_sampled(points: FloatArray) -> DrivenPath:
    """The path along ``points`` (n, 2), sampled every ``_STEP``, with smoothed yaw."""
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    even = np.arange(0.0, driven[-1], _STEP)
    x, y = np.interp(even, driven, points[:, 0]), np.interp(even, driven, points[:, 1])
    yaw = np.unwrap(np.arctan2(np.diff(y), np.diff(x)))
    return DrivenPath(even, x, y, _smooth(np.append(yaw, yaw[-1]), _YAW_SMOOTHING))


def _smooth(values: FloatArray, metres: float) -> FloatArray:
    """Values (n, ...) every ``_STEP`` of path, smoothed by a Gaussian with deviation ``metres``."""
    from scipy.ndimage import gaussian_filter1d

    smooth: FloatArray = gaussian_filter1d(values, metres / _STEP, axis=0, mode="nearest")
    return smooth


def _wander(
    driven: FloatArray, settings: SimulationSettings, rng: np.random.Generator
) -> FloatArray:
    """Offset to the left (metres) along the path, interpolated between random knots."""
    knots = np.arange(0.0, driven[-1] + settings.lateral_knots, settings.lateral_knots)
    offset = rng.uniform(-settings.lateral_offset, settings.lateral_offset, len(knots))
    return np.interp(driven, knots, offset)


def _scan_times(
    path: DrivenPath, period: int, settings: SimulationSettings, rng: np.random.Generator
) -> IntArray:
    """Microseconds after the start, evenly spaced along the path with jitter.

    The first scan comes after a random distance: with equal phases of the two drives many queries
    would be exactly half a map spacing from their nearest place.
    """
    driven = np.arange(rng.uniform(0.0, 20.0), path.driven[-1], settings.scan_spacing)
    driven = driven + rng.uniform(-0.15, 0.15, len(driven)) * settings.scan_spacing
    times = np.round(np.maximum(driven, 0.0) / settings.speed * 1e6).astype(np.int64)
    between = rng.integers(max(period // 5, 1), max(period * 4 // 5, 2), len(driven))
    return times // period * period + between


def _sway(tilt_deg: float, rng: np.random.Generator) -> Sway:
    """Sines of 0.1 to 0.6 Hz whose sum has the standard deviation ``tilt_deg``."""
    amplitude = np.full(_SWAYS, np.deg2rad(tilt_deg) * np.sqrt(2.0 / _SWAYS))
    frequency = 2 * np.pi * rng.uniform(0.1, 0.6, _SWAYS)
    return Sway(amplitude, frequency, rng.uniform(0.0, 2 * np.pi, _SWAYS))
