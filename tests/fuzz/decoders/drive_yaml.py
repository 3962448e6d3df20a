"""The file that describes a custom drive, as docs/custom_data.md says; YAML itself is PyYAML's."""

import math
import re
from dataclasses import dataclass
from typing import Any

import yaml

from fuzz.decoders import poses
from fuzz.files import UndecidedError, UndecodableError

_KEYS = {
    *("scans", "format", "poses", "pose_format", "sensor_in_body", "up", "world_up"),
    *("sensor_height", "z_band", "azimuth", "range", "name"),
}
_UP = {
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}
_SAME = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0]]


@dataclass(frozen=True)
class Drive:
    """What such a file says of one drive."""

    scans: str
    poses: str
    pose_format: str
    to_body: poses.Pose
    up: str
    world_up: str

    def upright(self, pose: poses.Pose) -> poses.Pose:
        """World <- sensor, both z up, from the file's world <- body."""
        sensor = _axes(self.up)
        world = (
            poses.compose(sensor, poses.inverse(self.to_body))
            if self.world_up == "sensor"
            else _axes(self.world_up)
        )
        inner = poses.compose(pose, poses.compose(self.to_body, poses.inverse(sensor)))
        return poses.compose(world, inner)


def drive_of(content: bytes) -> Drive:
    """The only drive of a file."""
    try:
        values = yaml.safe_load(content.decode("utf-8-sig"))
    except (yaml.YAMLError, ValueError, RecursionError, TypeError, AttributeError) as error:
        raise UndecodableError("no YAML") from error
    if isinstance(values, dict) and "drives" in values:
        raise UndecidedError  # several drives
    if not isinstance(values, dict) or not set(values) <= _KEYS:
        raise UndecodableError("other keys")
    values = {key: value for key, value in values.items() if value is not None}
    for key in ("scans", "poses"):
        if not isinstance(values.get(key), str):
            raise UndecodableError(f"no {key}")
    height = values.get("sensor_height")
    if isinstance(height, str):
        raise UndecidedError  # a number in quotes
    if type(height) not in (int, float) or not (0 < height < math.inf):
        raise UndecodableError("no height")
    for key in ("z_band", "azimuth", "range"):
        _band(values.get(key))
    up, world_up = values.get("up", "z"), values.get("world_up", "z")
    pose_format = values.get("pose_format", "kitti")
    if not all(isinstance(word, str) for word in (up, world_up, pose_format)):
        raise UndecodableError("a word of another type")
    if up not in _UP or world_up not in (*_UP, "sensor") or pose_format not in ("kitti", "tum"):
        raise UndecodableError("an unknown word")
    if not isinstance(values.get("name", "x"), str) or not isinstance(values.get("format"), str):
        raise UndecodableError("a word of another type")
    to_body = _transform(values.get("sensor_in_body"))
    paths = [re.sub(r"^(\./)+|/+$", "", values[key]) for key in ("scans", "poses")]
    return Drive(paths[0], paths[1], pose_format, to_body, up, world_up)


def _band(value: Any) -> None:
    if value is None:
        return
    if (
        not isinstance(value, list)
        or len(value) != 2
        or any(isinstance(v, str | bool) for v in value)
    ):
        raise UndecidedError
    low, high = value
    if type(low) not in (int, float) or type(high) not in (int, float) or not low < high:
        raise UndecodableError("a band that is none")


def _transform(value: Any) -> poses.Pose:
    if value is None:
        return _SAME
    if not isinstance(value, list) or any(type(v) not in (int, float) for v in value):
        raise UndecidedError  # rows, texts, and paths of calibrations
    if len(value) != 12:
        raise UndecidedError
    try:
        pose = poses.of_matrix([float(v) for v in value])
    except OverflowError:
        pose = None
    if pose is None:
        raise UndecodableError("sensor_in_body is no rotation and translation")
    return pose


def _axes(name: str) -> poses.Pose:
    return [[*map(float, row), 0.0] for row in _UP[name]]
