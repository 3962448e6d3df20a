"""Reads and checks the YAML file that describes custom drives."""

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from reprlib import Repr
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.data.poses.pose_tables import poses_from_rows
from deepring.data.poses.rigid import rigid_rows
from deepring.data.readers import binary_formats
from deepring.data.readers.custom.custom_scans import UP, Band
from deepring.data.readers.kitti import read_calibration
from deepring.data.scans.names import ending_of
from deepring.errors import ConfigError, DataError, FileError
from deepring.io.numbers_as_text import real_number
from deepring.io.plain_yaml import plain_yaml
from deepring.io.text import read_text

ENDINGS = (".yaml", ".yml")
POSE_FORMATS = ("kitti", "tum")
#: World axes like those of the sensor, for poses relative to the first frame of the body.
SENSOR_WORLD = "sensor"

_DRIVES, _NAME = "drives", "name"
_SHORT = Repr()  # one line even for large or deep values
_SHORT.maxstring = _SHORT.maxother = 80


@dataclass(frozen=True, eq=False)
class DriveDescription:
    """One drive as described by its file; its folders and files are not checked yet.

    The fields after ``name`` are the file's keys, with types for OmegaConf.
    """

    file: Path
    name: str
    scans: Path
    sensor_height: float  # metres above the ground
    poses: Path | None = None  # None where they are not known: a recording
    format: str | None = None  # of .bin files
    pose_format: str = "kitti"
    sensor_in_body: Any = None  # (4, 4) float64; None is the identity
    up: str = "z"
    world_up: str = "z"
    z_band: Band | None = None  # metres above the ground
    azimuth: Band | None = None  # degrees
    range: Band | None = None  # metres


def is_drive_file(root: Path | str) -> bool:
    """True for a file that describes drives, by its name; False for a folder."""
    return ending_of(Path(root)) in ENDINGS and not Path(root).is_dir()


def read_drives(path: Path | str) -> dict[str, DriveDescription]:
    """The drives of a YAML file by name, in its order; paths in it are relative to its folder.

    Raises FileError for a file that cannot be read, and ConfigError, with file, key and value, for
    one that is not a mapping, an unknown or missing key, or an invalid value.
    """
    file = Path(path).expanduser().absolute()
    content = _mapping(file, "the file", _load(file))
    if _DRIVES not in content:
        name = content.pop(_NAME, None)
        name = file.stem if name is None else _text(file, _NAME, name)
        return {name: _drive(file, name, content, "")}
    entries = _mapping(file, _DRIVES, content.pop(_DRIVES))
    if not entries:
        raise _refusal(file, _DRIVES, entries, "at least one drive, NAME: {KEY: VALUE, ...}")
    drives = {}
    for name, values in entries.items():
        where = f"{_DRIVES}.{_text(file, f'{_DRIVES}, a name', name)}"
        keys = _mapping(file, where, {} if values is None else values)
        drives[name] = _drive(file, name, content | keys, f"{where}.")
    return drives


def _load(file: Path) -> Any:
    text = read_text(file, "a YAML file that describes a drive")
    try:
        return plain_yaml(text)
    except DataError as error:
        raise ConfigError(f"{file}: {error}") from error


def _drive(file: Path, name: str, values: dict[Any, Any], prefix: str) -> DriveDescription:
    """A drive with checked values; ``prefix`` precedes its keys in messages."""
    for key in values:
        if key not in _KEYS:
            text = key if isinstance(key, str) and len(key) < 80 else _SHORT.repr(key)
            raise ConfigError(
                f"{file}: {prefix}{text}: unknown key, expected {', '.join(_KEYS)}, and at the "
                f"top {_NAME} or {_DRIVES}"
            )
    required = [
        f.name for f in fields(DriveDescription) if f.default is MISSING and f.name in _KEYS
    ]
    for key in required:
        if key not in values:
            raise ConfigError(f"{file}: {prefix}{key}: missing, expected {_KEYS[key][0]}: add it")
    arguments = {
        key: _parse(file, key, value, prefix)
        for key, value in values.items()
        if value is not None or key in required  # an empty value counts as missing
    }
    return DriveDescription(file, name, **arguments)


def _parse(file: Path, key: str, value: Any, prefix: str) -> Any:
    """The value of a key, with its type checked by OmegaConf and its range by `_KEYS`."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    description, parse = _KEYS[key]
    config = OmegaConf.structured(DriveDescription)
    OmegaConf.set_readonly(config, False)
    try:
        if isinstance(value, str) and not value.strip():
            raise ValueError("blank")  # as a path it would be the folder itself
        config[key] = value
        return parse(file, config[key])
    except FileError as error:
        raise FileError(f"{file}: {prefix}{key}: {error}") from error
    except (OmegaConfBaseException, ValueError, TypeError, OverflowError, RuntimeError):
        formats = ", ".join(binary_formats())
        raise _refusal(file, prefix + key, value, description.format(formats=formats)) from None


def _refusal(file: Path, key: str, value: Any, description: str) -> ConfigError:
    return ConfigError(f"{file}: {key}: {_SHORT.repr(value)}, expected {description}")


def _mapping(file: Path, key: str, value: Any) -> dict[Any, Any]:
    if not isinstance(value, dict):
        raise _refusal(file, key, value, "a mapping, KEY: VALUE on each line")
    return dict(value)


def _text(file: Path, key: str, value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise _refusal(file, key, value, "text; put numbers and dates in quotes")
    return value


def _path(file: Path, value: Path) -> Path:
    return file.parent / value.expanduser()


def _band(least: float = -math.inf, span: float = math.inf) -> Callable[[Path, Any], Band]:
    def band(_: Path, value: Any) -> Band:
        low, high = checks.interval("band", list(value))
        if low < least or high - low > span:
            raise ValueError("out of bounds")
        return low, high

    return band


def _transform(file: Path, value: Any) -> NDArray[np.float64]:
    """A pose (4, 4) from 12 or 16 numbers, as a list, rows or text, or Tr of a calib.txt."""
    try:
        parts = [real_number(part) for part in value.split()] if isinstance(value, str) else value
        numbers = np.array(parts, dtype=np.float64)
    except ValueError:
        if isinstance(value, str):
            return read_calibration(_path(file, Path(value)))
        raise
    numbers = numbers.ravel()
    if numbers.size == 16 and np.array_equal(numbers[12:], [0, 0, 0, 1]):
        numbers = numbers[:12]
    pose = poses_from_rows(numbers.reshape(1, 12))
    if not rigid_rows(pose)[0]:
        raise ValueError("not rigid")
    return pose[0]


def _one_of(*choices: str) -> tuple[str, Callable[[Path, str], str]]:
    return f"one of {', '.join(choices)}", lambda _, value: checks.one_of("key", value, choices)


#: By key: a description of its value for messages, and a function that parses the value.
_KEYS: dict[str, tuple[str, Callable[[Path, Any], Any]]] = {
    "scans": ("the folder of the scans, as text; put numbers in quotes", _path),
    "format": (
        "the format of the .bin files, one of {formats}",
        lambda _, value: checks.one_of("format", value, binary_formats()),
    ),
    "poses": ("the file of the poses, as text; put numbers in quotes", _path),
    "pose_format": _one_of(*POSE_FORMATS),
    "sensor_in_body": (
        "12 numbers (3x4, row by row), a 4x4 matrix, or the path of a calib.txt with 'Tr:'; a "
        "rotation and a translation in metres",
        _transform,
    ),
    "up": _one_of(*UP),
    "world_up": _one_of(*UP, SENSOR_WORLD),
    "sensor_height": (
        "the height of the sensor above the ground in metres, more than 0 (0.01 if z is 0 there)",
        lambda _, value: checks.positive("sensor_height", value),
    ),
    "z_band": ("[LOW, HIGH] in metres above the ground, LOW < HIGH", _band()),
    "azimuth": (
        "[LOW, HIGH] in degrees, LOW < HIGH, at most 360 wide, e.g. [90, 270] across 180",
        _band(span=360),
    ),
    "range": ("[LOW, HIGH] in metres from the sensor, at least 0, LOW < HIGH", _band(least=0)),
}
