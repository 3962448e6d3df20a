"""The settings of a simulation, their defaults and ranges."""

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

from deepring.checks import one_of
from deepring.errors import ConfigError
from deepring.simulation.measures import LOWEST_CEILING, WorldKind
from deepring.simulation.sensor_models import SENSORS

Layout = Literal["nclt", "mulran", "custom"]


@dataclass(frozen=True)
class SimulationSettings:
    """The settings of a simulation. Lengths in metres, angles in degrees, shares in [0, 1].

    The defaults are the preset ``nclt``; `mulran` has other values. The train and test parts of
    the world are street grids of ``rows`` rows and ``train_columns`` or ``test_columns`` columns,
    joined by one street across the gap between the regions. Raises ConfigError for a value out of
    range.
    """

    layout: Layout = "nclt"  # of the files; also determines the sensor
    seed: int = 0  # drives, parked cars, moving objects, noise
    world_seed: int | None = None  # streets and buildings; None: the same as seed

    # the world
    world: WorldKind = "campus"  # docs/simulation.md describes the kinds
    block: float = 85.0  # distance between crossings
    train_columns: int = 5  # columns of the street grid that is trained on
    test_columns: int = 4  # ... and of the one that is tested on
    rows: int = 4  # of both grids
    crossing_jitter: float = 9.0  # largest offset of crossings from the regular grid
    building_prototypes: int = 2  # of campus, city, tunnels; with fewer, more places look alike
    building_share: float = 0.8  # share of their plots with a building
    street_variety: float = 1.0  # difference between the sides of their streets
    facade_parts: float = 4.0  # mean number of protrusions on their facades
    tree_spacing: float = 9.0  # between trees of a row along a street
    streets_missing: float = 0.0  # largest share of the grid's streets left out
    street_bend: float = 0.0  # largest offset of a street's middle from the straight line
    period: float = 24.0  # of the facades in the world "repeating"
    ground_relief: float = 0.8  # standard deviation of the ground's height

    # differences between the sessions, and moving objects
    trees_changed: float = 0.4  # share of trees in only one session
    structures_changed: float = 0.15  # the same for facade parts, walls, sheds, clutter
    bare_season: float = 1.5  # factor of the crowns' transparency in the database
    parking_share: float = 0.55  # share of occupied parking slots in each session
    parking_changed: float = 1.0  # share of the slots filled anew in the second session
    movers: float = 14.0  # mean number of moving objects around the robot per scan
    mover_vehicle_share: float = 0.3  # the others are pedestrians

    # the sensor
    sensor: str | None = None  # of the database; a name of `SENSORS`, in the layout custom only
    query_sensor: str | None = None  # None: the same as the database's, as all of query_
    sensor_height: float | None = None  # above the ground
    query_sensor_height: float | None = None  # in the second session; None: as in the first
    upside_down: bool = False  # whether the sensor hangs with its top below
    query_upside_down: bool | None = None  # in the second session; None: as in the first
    mount_roll_deg: float = 0.0  # of the sensor on the platform: about its x, then y, then z
    mount_pitch_deg: float = 0.0  # about y
    mount_yaw_deg: float = 0.0  # about z
    query_mount_roll_deg: float | None = None  # in the second session; None: as in the first
    query_mount_pitch_deg: float | None = None  # likewise
    query_mount_yaw_deg: float | None = None  # likewise
    azimuths: int | None = 1085  # columns per revolution (1024 in MulRan); None: the data sheet's
    max_range: float = 100.0  # metres
    range_noise: float | None = 0.025  # standard deviation; None: the data sheet's
    dropout_near: float = 0.02  # share of returns lost at the sensor ...
    dropout_far: float = 0.25  # ... and at max_range; it grows with the squared distance
    tilt_deg: float = 3.0  # standard deviation of the platform's roll and of its pitch
    blind_width_deg: float = 0.0  # sector without returns, centred on the LiDAR's +x
    motion_distortion: bool = False  # True: the platform moves during a sweep, points as measured
    rain_mm_per_hour: float = 0.0  # drops return some beams and weaken all
    labels: bool = False  # True: a file with the class of each point beside each scan

    # the drives
    lateral_offset: float = 5.0  # largest varying offset of the path to either side
    lateral_knots: float = 40.0  # metres of path between random offsets
    lane_offset: float = 0.0  # constant offset to the right of the street's middle
    reversed_share: float = 0.5  # share of query passes opposite to all database passes
    scan_spacing: float = 2.0  # metres of path between scans
    speed: float = 2.0  # metres per second
    pose_rate: int = 100  # ground-truth rows per second

    def __post_init__(self) -> None:
        one_of("layout", self.layout, Layout)
        one_of("world", self.world, WorldKind)
        for name, (low, high) in _RANGES.items():
            _check_range(name, getattr(self, name), low, high)
        for name, (low, high) in _OPTIONAL.items():
            if getattr(self, name) is not None:
                _check_range(name, getattr(self, name), low, high)
        for name in _SWITCHES:
            _check_switch(name, getattr(self, name))
        _check_ceiling(self)
        if self.layout != "custom":
            _check_own_sensor(self)
            return
        one_of("sensor", self.sensor, SENSORS)
        one_of("query_sensor", self.query_sensor, (*SENSORS, None))
        if self.sensor_height is None:
            _check_range("sensor_height", None, *_OPTIONAL["sensor_height"])

    @property
    def streets_seed(self) -> int:
        """The seed of streets, buildings and trees, which both sessions share."""
        return self.seed if self.world_seed is None else self.world_seed

    @property
    def corridor(self) -> float:
        """Half the width without standing objects along each street (metres)."""
        return self.lane_offset + self.lateral_offset + 1.5

    def as_dict(self) -> dict[str, object]:
        """All settings by name, for the manifest."""
        return asdict(self)


_MANY = 2**31 - 1
_BELOW_CEILING = 0.2  # a sensor is at least this far below every ceiling (metres)
_RANGES: dict[str, tuple[float, float]] = {
    "seed": (0, _MANY),
    "block": (40.0, 500.0),
    "train_columns": (2, 50),
    "test_columns": (2, 50),
    "rows": (2, 50),
    "crossing_jitter": (0.0, 20.0),
    "building_prototypes": (1, 1000),
    "building_share": (0.0, 1.0),
    "street_variety": (0.0, 1.0),
    "facade_parts": (0.0, 50.0),
    "tree_spacing": (2.0, 1000.0),
    "streets_missing": (0.0, 0.5),
    "street_bend": (0.0, 20.0),
    "period": (8.0, 100.0),
    "ground_relief": (0.0, 3.0),
    "trees_changed": (0.0, 1.0),
    "structures_changed": (0.0, 1.0),
    "bare_season": (0.1, 10.0),
    "parking_share": (0.0, 1.0),
    "parking_changed": (0.0, 1.0),
    "movers": (0.0, 200.0),
    "mover_vehicle_share": (0.0, 1.0),
    "max_range": (10.0, 120.0),
    "dropout_near": (0.0, 1.0),
    "dropout_far": (0.0, 1.0),
    "tilt_deg": (0.0, 10.0),
    "blind_width_deg": (0.0, 359.0),
    "rain_mm_per_hour": (0.0, 100.0),
    "mount_roll_deg": (-20.0, 20.0),
    "mount_pitch_deg": (-20.0, 20.0),
    "mount_yaw_deg": (-180.0, 180.0),
    "lateral_offset": (0.0, 10.0),
    "lateral_knots": (5.0, 1000.0),
    "lane_offset": (0.0, 10.0),
    "reversed_share": (0.0, 1.0),
    "scan_spacing": (0.1, 50.0),
    "speed": (0.1, 40.0),
    "pose_rate": (1, 1000),
}

#: The same of settings that can be None.
_OPTIONAL: dict[str, tuple[float, float]] = {
    "world_seed": (0, _MANY),
    "azimuths": (8, 4096),
    "range_noise": (0.0, 1.0),
    "sensor_height": (0.2, 10.0),
    "query_sensor_height": (0.2, 10.0),
    "query_mount_roll_deg": (-20.0, 20.0),
    "query_mount_pitch_deg": (-20.0, 20.0),
    "query_mount_yaw_deg": (-180.0, 180.0),
}
_SWITCHES = ("upside_down", "query_upside_down", "motion_distortion", "labels")
#: Settings that the layouts with a sensor of their own do not have, nor those with ``query_``.
_OF_ANY_SENSOR = (
    *("sensor", "sensor_height", "upside_down"),
    *("mount_roll_deg", "mount_pitch_deg", "mount_yaw_deg"),
)


def _check_own_sensor(settings: SimulationSettings) -> None:
    """Raise ConfigError for settings that a layout with its own sensor does not have."""
    for field in fields(settings):
        value: Any = getattr(settings, field.name)
        if field.name.removeprefix("query_") in _OF_ANY_SENSOR and value != field.default:
            raise ConfigError(
                f"{field.name}: {value!r}, expected {field.default} in the layout "
                f"{settings.layout}, which has a sensor of its own; choose the layout custom"
            )
        if field.name in ("azimuths", "range_noise") and value is None:
            _check_range(field.name, value, *_OPTIONAL[field.name])


def _check_ceiling(settings: SimulationSettings) -> None:
    """Raise ConfigError for a sensor as high as the ceilings that it would drive below."""
    if settings.world not in LOWEST_CEILING:
        return
    ceiling = LOWEST_CEILING[settings.world]
    for name in ("sensor_height", "query_sensor_height"):
        height = getattr(settings, name)
        if height is not None and height > ceiling - _BELOW_CEILING:
            raise ConfigError(
                f"{name}: {height!r}, expected at most {ceiling - _BELOW_CEILING:g} in the world "
                f"{settings.world}, whose lowest ceiling is {ceiling:g} m above the ground"
            )


def _check_switch(name: str, value: object) -> None:
    if not (isinstance(value, bool) or (value is None and name.startswith("query_"))):
        raise ConfigError(f"{name}: {value!r}, expected True or False")


def _check_range(name: str, value: object, low: float, high: float) -> None:
    whole = isinstance(low, int)
    types = int if whole else (int, float)
    fits = isinstance(value, types) and not isinstance(value, bool)
    if not fits or not low <= value <= high:  # type: ignore[operator]
        kind = "a whole number" if whole else "a number"
        raise ConfigError(f"{name}: {value!r}, expected {kind} from {low} to {high}")
