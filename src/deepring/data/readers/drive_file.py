"""The YAML file that describes drives of one's own: read, checked, and refused with a reason."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from reprlib import Repr
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from deepring.data.readers.custom_scans import UP, Band
from deepring.data.readers.kitti import read_calibration
from deepring.data.readers.scan_files import BINARY
from deepring.data.readers.trajectory import poses_from_rows, rigid_rows
from deepring.errors import DeepringError

ENDINGS = (".yaml", ".yml")
POSE_FORMATS = ("kitti", "tum")
#: Besides an axis: the poses' world is the body's first frame; take the sensor's for it.
SENSOR_WORLD = "sensor"

_DRIVES, _NAME = "drives", "name"
_SHORT = Repr()  # values go into one line, however large or deep they are
_SHORT.maxstring = _SHORT.maxother = 80


@dataclass(frozen=True, eq=False)
class Drive:
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

    def error(self, expected: str) -> DeepringError:
        return DeepringError(
            f"{self.file}: {self.key}: {_SHORT.repr(self.value)}; expected {expected}"
        )


def is_drive_file(root: Path | str) -> bool:
    """Whether ``root`` is, by its name, a file that describes drives and no folder of data."""
    return Path(root).suffix in ENDINGS and not Path(root).is_dir()


def read_drives(path: Path | str) -> dict[str, Drive]:
    """The drives of a YAML file by name, in its order; paths in it are relative to its folder.

    Raises DeepringError naming file, key and value: for a file that cannot be read or is no
    mapping, an unknown or missing key, and a value that is not of its key's kind.
    """
    file = Path(path).expanduser().absolute()
    content = _mapping(_Entry(file, "the file", _loaded(file)))
    if _DRIVES not in content:
        given = content.pop(_NAME, None)
        name = file.stem if given is None else _text(_Entry(file, _NAME, given))
        return {name: _drive(file, name, content, "")}
    shared = {key: value for key, value in content.items() if key != _DRIVES}
    drives = _mapping(_Entry(file, _DRIVES, content[_DRIVES]))
    if not drives:
        raise _Entry(file, _DRIVES, drives).error("at least one drive, NAME: {KEY: VALUE, ...}")
    found = {}
    for name, own in drives.items():
        where = f"{_DRIVES}.{_text(_Entry(file, f'{_DRIVES}, a name', name))}"
        values = shared | _mapping(_Entry(file, where, {} if own is None else own))
        found[name] = _drive(file, name, values, f"{where}.")
    return found


def _loaded(file: Path) -> Any:
    try:
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise DeepringError(
            f"{file}: cannot be read ({error}); expected a YAML file that describes a drive"
        ) from error
    except Exception as error:  # broken tags make the library raise almost anything
        reason = " ".join(str(error).split())
        raise DeepringError(
            f"{file}: no YAML ({type(error).__name__}: {reason}); mend that line"
        ) from error


def _drive(file: Path, name: str, values: dict[Any, Any], prefix: str) -> Drive:
    """A drive of checked values; ``prefix`` leads to its keys in messages."""
    for key in values:
        if key not in _KINDS:
            raise DeepringError(
                f"{file}: {prefix}{_plain(key)}: no known key; expected "
                f"{', '.join(_KINDS)}, and at the top {_NAME} or {_DRIVES}"
            )
    for key in ("scans", "poses", "sensor_height"):
        if key not in values:
            raise DeepringError(
                f"{file}: {prefix}{key}: missing; expected {_REQUIRED[key]}: add it"
            )
    given = {
        key: _KINDS[key](_Entry(file, prefix + key, value))
        for key, value in values.items()
        if value is not None or key in _REQUIRED  # an empty value is one left out
    }
    return Drive(file, name, **given)


def _plain(key: Any) -> str:
    return key if isinstance(key, str) and len(key) < 80 else _SHORT.repr(key)


def _mapping(entry: _Entry) -> dict[Any, Any]:
    if not isinstance(entry.value, dict):
        raise entry.error("a mapping, KEY: VALUE on each line")
    return dict(entry.value)


def _text(entry: _Entry) -> str:
    if not isinstance(entry.value, str) or not entry.value.strip():
        raise entry.error("text; put numbers and dates into quotes")
    return entry.value


def _path(entry: _Entry) -> Path:
    return entry.file.parent / Path(_text(entry)).expanduser()


def _one_of(choices: tuple[str, ...]) -> Callable[[_Entry], str]:
    def chosen(entry: _Entry) -> str:
        if not isinstance(entry.value, str) or entry.value not in choices:
            raise entry.error(f"one of {', '.join(choices)}")
        return entry.value

    return chosen


def _number(value: Any) -> float:
    """A finite float, or NaN where the value is none."""
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return number if math.isfinite(number) else math.nan


def _height(entry: _Entry) -> float:
    height = _number(entry.value)
    if not height > 0:  # also refuses NaN
        raise entry.error(
            "metres of the sensor above the ground, more than 0 (0.01 where z is 0 on the ground)"
        )
    return height


def _band(unit: str, span: float = math.inf, least: float = -math.inf) -> Callable[[_Entry], Band]:
    def band(entry: _Entry) -> Band:
        value = entry.value
        expected = f"[LOW, HIGH] in {unit}, LOW < HIGH"
        if not isinstance(value, list) or len(value) != 2:
            raise entry.error(expected)
        low, high = (_number(number) for number in value)
        if not (low < high and low >= least and high - low <= span):
            raise entry.error(expected)
        return low, high

    return band


def _transform(entry: _Entry) -> NDArray[np.float64]:
    """A pose (4, 4) of 12 or 16 numbers, as a list, rows or text; or Tr of a calib.txt."""
    expected = (
        "12 numbers (3x4, row by row), a 4x4 matrix, or the path of a calib.txt with 'Tr:'; "
        "a rotation and a shift in metres"
    )
    numbers = _numbers(entry.value)
    if numbers is None:
        if not isinstance(entry.value, str):
            raise entry.error(expected)
        return read_calibration(_path(entry))
    if numbers.size == 16 and np.array_equal(numbers[12:], [0, 0, 0, 1]):
        numbers = numbers[:12]
    if numbers.size != 12:
        raise entry.error(expected)
    pose = poses_from_rows(numbers.reshape(1, 12))
    if not rigid_rows(pose)[0]:
        raise entry.error(expected)
    return pose[0]


def _numbers(value: Any) -> NDArray[np.float64] | None:
    """All numbers of a list, of a list of rows or of a text, in order; None where it is none."""
    if isinstance(value, str):
        try:
            return np.array(value.split(), dtype=np.float64) if value.strip() else None
        except ValueError:
            return None
    if not isinstance(value, list) or len(value) > 16:
        return None
    flat = [n for row in value for n in (row if isinstance(row, list) else [row])][:17]
    return np.array([_number(number) for number in flat])


#: What the value of each key of a drive must be.
_KINDS: dict[str, Callable[[_Entry], Any]] = {
    "scans": _path,
    "format": _one_of(tuple(BINARY)),
    "poses": _path,
    "pose_format": _one_of(POSE_FORMATS),
    "sensor_in_body": _transform,
    "up": _one_of(tuple(UP)),
    "world_up": _one_of((*UP, SENSOR_WORLD)),
    "sensor_height": _height,
    "z_band": _band("metres above the ground"),
    "azimuth": _band("degrees, at most 360 wide, such as [90, 270] across 180", span=360),
    "range": _band("metres from the sensor, at least 0", least=0),
}
_REQUIRED = {
    "scans": "the folder of the scans",
    "poses": "the file of their poses",
    "sensor_height": "metres of the sensor above the ground",
}
