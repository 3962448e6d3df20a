"""The YAML file that describes custom drives: read, checked, and refused with a reason."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from pathlib import Path
from reprlib import Repr
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from deepring import checks
from deepring.data.poses.pose_tables import poses_from_rows, rigid_rows
from deepring.data.readers import binary_formats
from deepring.data.readers.custom.custom_scans import UP, Band
from deepring.data.readers.kitti import read_calibration
from deepring.errors import ConfigError, FileError

#: OmegaConf's mark of a value that must be given.
MISSING = "???"

ENDINGS = (".yaml", ".yml")
POSE_FORMATS = ("kitti", "tum")
#: Besides an axis: the poses' world is the body's first frame; take the sensor's for it.
SENSOR_WORLD = "sensor"

_DRIVES, _NAME = "drives", "name"
_SHORT = Repr()  # values go into one line, however large or deep they are
_SHORT.maxstring = _SHORT.maxother = 80


@dataclass
class DriveSchema:
    """The keys of one drive, their types and defaults, as OmegaConf checks them."""

    scans: str = MISSING
    format: str | None = None
    poses: str = MISSING
    pose_format: str = "kitti"
    sensor_in_body: Any = None
    up: str = "z"
    world_up: str = "z"
    sensor_height: float = MISSING  # type: ignore[assignment]
    z_band: list[float] | None = None
    azimuth: list[float] | None = None
    range: list[float] | None = None


_KEYS = {key.name: key for key in fields(DriveSchema)}
_EXPECTED = {
    "scans": "the folder of the scans, as text; put numbers into quotes",
    "format": "what .bin files hold: one of {formats}",
    "poses": "the file of their poses, as text; put numbers into quotes",
    "pose_format": f"one of {', '.join(POSE_FORMATS)}",
    "sensor_in_body": "12 numbers (3x4, row by row), a 4x4 matrix, or the path of a calib.txt with "
    "'Tr:'; a rotation and a shift in metres",
    "up": f"one of {', '.join(UP)}",
    "world_up": f"one of {', '.join((*UP, SENSOR_WORLD))}",
    "sensor_height": "metres of the sensor above the ground, more than 0 (0.01 where z is 0 on the "
    "ground)",
    "z_band": "[LOW, HIGH] in metres above the ground, LOW < HIGH",
    "azimuth": "[LOW, HIGH] in degrees, LOW < HIGH, at most 360 wide, such as [90, 270] across 180",
    "range": "[LOW, HIGH] in metres from the sensor, at least 0, LOW < HIGH",
}


@dataclass(frozen=True, eq=False)
class DriveDescription:
    """One drive as its file describes it; folders and files are not looked into yet."""

    file: Path
    name: str
    scans: Path
    poses: Path
    sensor_height: float  # metres above the ground
    format: str | None = None  # what .bin files hold
    pose_format: str = "kitti"
    sensor_in_body: NDArray[np.float64] | None = None  # (4, 4); None is the identity
    up: str = "z"
    world_up: str = "z"
    z_band: Band | None = None  # metres above the ground
    azimuth: Band | None = None  # degrees
    range: Band | None = None  # metres


@dataclass(frozen=True)
class _Entry:
    """One value and where it stands, for the error that it may deserve."""

    file: Path
    key: str
    value: Any

    def error(self, expected: str) -> ConfigError:
        return ConfigError(
            f"{self.file}: {self.key}: {_SHORT.repr(self.value)}; expected {expected}"
        )


def is_drive_file(root: Path | str) -> bool:
    """True for a file that describes drives, told by its name; False for a folder of data."""
    return Path(root).suffix in ENDINGS and not Path(root).is_dir()


def read_drives(path: Path | str) -> dict[str, DriveDescription]:
    """The drives of a YAML file by name, in its order; paths in it are relative to its folder.

    Raises FileError for a file that cannot be read, and ConfigError, naming file, key and value,
    for one that is no mapping, an unknown or missing key, and a value that is not of its key's
    kind.
    """
    file = Path(path).expanduser().absolute()
    content = _mapping(_Entry(file, "the file", _loaded(file)))
    if _DRIVES not in content:
        name = content.pop(_NAME, None)
        name = file.stem if name is None else _text(_Entry(file, _NAME, name))
        return {name: _drive(file, name, content, "")}
    shared = {key: value for key, value in content.items() if key != _DRIVES}
    entries = _mapping(_Entry(file, _DRIVES, content[_DRIVES]))
    if not entries:
        raise _Entry(file, _DRIVES, entries).error("at least one drive, NAME: {KEY: VALUE, ...}")
    drives = {}
    for name, values in entries.items():
        where = f"{_DRIVES}.{_text(_Entry(file, f'{_DRIVES}, a name', name))}"
        of_drive = _mapping(_Entry(file, where, {} if values is None else values))
        drives[name] = _drive(file, name, shared | of_drive, f"{where}.")
    return drives


def _loaded(file: Path) -> Any:
    try:
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no text"
        raise FileError(
            f"{file}: cannot be read ({reason}); expected a YAML file that describes a drive"
        ) from error
    except Exception as error:  # broken tags make the library raise almost anything
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark is not None else "some line"
        raise ConfigError(f"{file}: no YAML from {where} on; mend that line") from error


def _drive(file: Path, name: str, values: dict[Any, Any], prefix: str) -> DriveDescription:
    """A drive of checked values; ``prefix`` leads to its keys in messages."""
    for key in values:
        if key not in _KEYS:
            raise ConfigError(
                f"{file}: {prefix}{_shown(key)}: no known key; expected "
                f"{', '.join(_KEYS)}, and at the top {_NAME} or {_DRIVES}"
            )
    for key, of_schema in _KEYS.items():
        if of_schema.default == MISSING and key not in values:
            raise ConfigError(f"{file}: {prefix}{key}: missing; expected {_EXPECTED[key]}: add it")
    checked = {
        key: _checked(_Entry(file, prefix + key, value), key)
        for key, value in values.items()
        if value is not None or _KEYS[key].default == MISSING  # an empty value is one left out
    }
    return DriveDescription(file, name, **checked)


def _checked(entry: _Entry, key: str) -> Any:
    """The value of a key: of its type, which OmegaConf checks, and within what it means."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    expected = _EXPECTED[key].format(formats=", ".join(binary_formats()))
    if "str" in str(_KEYS[key].type) and not isinstance(entry.value, str):
        raise entry.error(expected)  # OmegaConf would make text of a number: "0" of 00
    value = entry.value
    try:
        if _KEYS[key].type is not Any:
            typed = OmegaConf.structured(DriveSchema)
            typed[key] = value
            value = typed[key]
        return _VALIDATORS[key](entry.file, value)
    except FileError:
        raise
    except (OmegaConfBaseException, ValueError, TypeError, OverflowError, RuntimeError):
        raise entry.error(expected) from None


def _shown(key: Any) -> str:
    return key if isinstance(key, str) and len(key) < 80 else _SHORT.repr(key)


def _mapping(entry: _Entry) -> dict[Any, Any]:
    if not isinstance(entry.value, dict):
        raise entry.error("a mapping, KEY: VALUE on each line")
    return dict(entry.value)


def _text(entry: _Entry) -> str:
    if not isinstance(entry.value, str) or not entry.value.strip():
        raise entry.error("text; put numbers and dates into quotes")
    return entry.value


def _path(file: Path, value: str) -> Path:
    if not value.strip():
        raise ValueError("blank")
    return file.parent / Path(value).expanduser()


def _band(least: float = -math.inf, span: float = math.inf) -> Callable[[Path, Any], Band]:
    def band(_: Path, value: Any) -> Band:
        low, high = checks.interval("band", list(value))
        if low < least or high - low > span:
            raise ValueError("out of bounds")
        return low, high

    return band


def _one_of(choices: Callable[[], Collection[str]]) -> Callable[[Path, str], str]:
    return lambda _, value: checks.one_of("key", value, choices())


def _transform(file: Path, value: Any) -> NDArray[np.float64]:
    """A pose (4, 4) of 12 or 16 numbers, as a list, rows or text; or Tr of a calib.txt."""
    try:
        numbers = np.array(value.split() if isinstance(value, str) else value, dtype=np.float64)
    except ValueError:
        if isinstance(value, str):
            return read_calibration(_path(file, value))
        raise
    numbers = numbers.ravel()
    if numbers.size == 16 and np.array_equal(numbers[12:], [0, 0, 0, 1]):
        numbers = numbers[:12]
    pose = poses_from_rows(numbers.reshape(1, 12))
    if not rigid_rows(pose)[0]:
        raise ValueError("not rigid")
    return pose[0]


#: What a value of its key's type must be besides: each returns it as the drive has it, or raises.
_VALIDATORS: dict[str, Callable[[Path, Any], Any]] = {
    "scans": _path,
    "format": _one_of(binary_formats),
    "poses": _path,
    "pose_format": _one_of(lambda: POSE_FORMATS),
    "sensor_in_body": _transform,
    "up": _one_of(lambda: UP),
    "world_up": _one_of(lambda: (*UP, SENSOR_WORLD)),
    "sensor_height": lambda _, value: checks.positive("sensor_height", value),
    "z_band": _band(),
    "azimuth": _band(span=360),
    "range": _band(least=0),
}
