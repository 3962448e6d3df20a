"""Which sensor each session has, and how it is mounted."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.simulation.rosette import Rosette
from deepring.simulation.sensor_models import SENSORS, SensorModel
from deepring.simulation.settings import SimulationSettings

FloatArray = NDArray[np.float64]

_FARTHEST = 120.0  # the largest max_range of the settings
#: Settings of the database's sensor; those of the query's begin with ``query_``.
_OF_SESSION = (
    *("sensor", "sensor_height", "upside_down"),
    *("mount_roll_deg", "mount_pitch_deg", "mount_yaw_deg"),
)


@dataclass(frozen=True, eq=False)
class Sensor:
    """A LiDAR on a platform, in a frame of the sensor whose z points up even if it hangs.

    ``elevations`` (B,) of the beams in that frame (rad) ascend. ``mount`` is the pose body <- that
    frame (4, 4), body x forward, y left, z up. ``body_height`` is the height of the body's origin
    above the ground (metres). Points from ``blind`` to ``range`` metres are measured, with the
    standard deviation ``noise``. ``starts_anywhere`` tells whether column 0 is at any azimuth. A
    sensor with a ``rosette`` has no beams and columns.
    """

    elevations: FloatArray
    mount: FloatArray
    body_height: float
    columns: int
    blind: float
    range: float
    noise: float
    starts_anywhere: bool
    upside_down: bool = False
    rosette: Rosette | None = None

    @property
    def height(self) -> float:
        """Height of the sensor above the ground, on level ground (metres)."""
        return self.body_height + float(self.mount[2, 3])

    @property
    def stored(self) -> FloatArray:
        """Rotation (3, 3): the device's own axes <- those of the frame with z up."""
        return np.diag([1.0, -1.0, -1.0]) if self.upside_down else np.eye(3)


def hdl32e_upside_down() -> Sensor:
    """NCLT's HDL-32E, mounted upside down, with beams from 10.67° down to 30.67° up.

    The lever arm is NCLT's, converted from z down to z up. The origin of the body frame is about
    0.15 m below the ground.
    """
    mount = pose_from(np.eye(3), [0.002, 0.004, 0.957])
    sensor = _mounted(SENSORS["hdl32e"], mount, body_height=-0.15, upside_down=True)
    elevations = np.deg2rad(np.linspace(-10.67, 30.67, 32))
    return replace(sensor, elevations=elevations, range=_FARTHEST)


def os1_64() -> Sensor:
    """MulRan's OS1-64: beams from 16.6° down to 16.6° up, mounted facing backwards."""
    roll, pitch, yaw = np.deg2rad([0.0001, 0.0003, 179.6654])
    mount = pose_from(rotation_from_rpy(roll, pitch, yaw), [1.7042, -0.021, 1.8047])
    sensor = _mounted(SENSORS["os1_64"], mount, body_height=0.0)
    return replace(sensor, blind=0.9, range=_FARTHEST)


def sensor_of(settings: SimulationSettings, session: int) -> Sensor:
    """The sensor of the database (session 0) or of the query (1)."""
    if settings.layout == "nclt":
        return hdl32e_upside_down()
    if settings.layout == "mulran":
        return os1_64()
    own: dict[str, Any] = {}
    for name in _OF_SESSION:
        value = getattr(settings, name)
        other = getattr(settings, f"query_{name}") if session == 1 else None
        own[name] = value if other is None else other
    angles = np.deg2rad([own["mount_roll_deg"], own["mount_pitch_deg"], own["mount_yaw_deg"]])
    mount = pose_from(rotation_from_rpy(*angles), [0.0, 0.0, own["sensor_height"]])
    return _mounted(SENSORS[own["sensor"]], mount, 0.0, upside_down=own["upside_down"])


def _mounted(
    model: SensorModel, mount: FloatArray, body_height: float, *, upside_down: bool = False
) -> Sensor:
    elevations = np.deg2rad(model.beams)
    return Sensor(
        elevations=-elevations[::-1] if upside_down else elevations,
        mount=mount,
        body_height=body_height,
        columns=model.columns,
        blind=model.blind,
        range=model.range,
        noise=model.noise,
        starts_anywhere=model.starts_anywhere,
        upside_down=upside_down,
        rosette=model.rosette,
    )
