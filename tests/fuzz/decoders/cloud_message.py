"""Messages of type sensor_msgs/PointCloud2, as ROS 1 and ROS 2 serialise them, and their points."""

import math
import struct
from dataclasses import dataclass
from typing import Any

from fuzz.decoders.points import Points, rounded, some
from fuzz.files import UndecidedError, UndecodableError

_FLOATS = {7: "f", 8: "d"}


@dataclass
class CloudMessage:
    """The fields of a message."""

    stamp: int
    """Nanoseconds."""
    height: int
    width: int
    fields: list[tuple[str, int, int, int]]
    """Name, offset, datatype, count."""
    bigendian: int
    point_step: int
    row_step: int
    data: bytes
    dense: int = 1


class _Stream:
    """Values one after the other; ``aligned`` ones begin at multiples of their size."""

    def __init__(self, content: bytes, start: int, order: str, aligned: bool) -> None:
        self.content, self.at, self.order = content, start, order
        self.start, self.aligned = start, aligned

    def number(self, kind: str) -> int:
        size = struct.calcsize(kind)
        if self.aligned:
            self.at += -(self.at - self.start) % size
        if self.at + size > len(self.content):
            raise UndecodableError("a message cut short")
        (value,) = struct.unpack_from(self.order + kind, self.content, self.at)
        self.at += size
        return int(value)

    def bytes(self) -> bytes:
        length = self.number("I")
        if self.at + length > len(self.content):
            raise UndecodableError("a message cut short")
        self.at += length
        return self.content[self.at - length : self.at]


def of_cdr(content: bytes) -> CloudMessage:
    """A message of ROS 2."""
    if len(content) < 4 or content[1] not in (0, 1):
        raise UndecodableError("no CDR message")
    stream = _Stream(content, 4, "<" if content[1] == 1 else ">", True)
    seconds, nanoseconds = stream.number("i"), stream.number("I")
    return _rest(stream, seconds * 10**9 + nanoseconds, True)


def of_ros1(content: bytes) -> CloudMessage:
    """A message of ROS 1."""
    stream = _Stream(content, 0, "<", False)
    stream.number("I")  # the sequence number
    seconds, nanoseconds = stream.number("I"), stream.number("I")
    return _rest(stream, seconds * 10**9 + nanoseconds, False)


def _rest(stream: _Stream, stamp: int, terminated: bool) -> CloudMessage:
    _text(stream.bytes(), terminated)
    height, width, count = (stream.number("I") for _ in range(3))
    fields = []
    for _ in range(count):
        name = _text(stream.bytes(), terminated)
        fields.append((name, stream.number("I"), stream.number("B"), stream.number("I")))
    big, point_step, row_step = stream.number("B"), stream.number("I"), stream.number("I")
    message = CloudMessage(
        stamp, height, width, fields, big, point_step, row_step, stream.bytes(), stream.number("B")
    )
    if len(stream.content) - stream.at > 3:
        raise UndecodableError("bytes after a message")
    if big > 1 or message.dense > 1:
        raise UndecidedError  # no truth value
    return message


def _text(raw: bytes, terminated: bool) -> str:
    if terminated:
        if raw[-1:] not in (b"\0", b""):
            raise UndecidedError  # a string without its end
        raw = raw[:-1]
    try:
        return raw.decode()
    except UnicodeDecodeError:
        raise UndecodableError("a name that is no text") from None


def encoded(message: CloudMessage, cdr: bool) -> bytes:
    """The message in bytes, of ROS 2 or of ROS 1."""
    out = bytearray()

    def number(kind: str, value: int) -> None:
        if cdr:
            out.extend(bytes(-len(out) % struct.calcsize(kind)))
        out.extend(struct.pack("<" + kind, value))

    def raw(content: bytes) -> None:
        number("I", len(content))
        out.extend(content)

    end = b"\0" if cdr else b""
    if not cdr:
        number("I", 0)
    number("i" if cdr else "I", message.stamp // 10**9)
    number("I", message.stamp % 10**9)
    raw(b"lidar" + end)
    for value in (message.height, message.width, len(message.fields)):
        number("I", value)
    for name, offset, datatype, count in message.fields:
        raw(name.encode() + end)
        number("I", offset)
        number("B", datatype)
        number("I", count)
    number("B", message.bigendian)
    number("I", message.point_step)
    number("I", message.row_step)
    raw(message.data)
    number("B", message.dense)
    return (b"\0\1\0\0" if cdr else b"") + bytes(out)


def points_of(message: CloudMessage) -> Points:
    """The points, row by row, without missing returns."""
    named: dict[str, Any] = {}
    for name, offset, datatype, _ in message.fields:
        if name in named and name in "xyz":
            raise UndecidedError
        named[name] = (offset, datatype)
    if any(axis not in named or named[axis][1] not in _FLOATS for axis in "xyz"):
        raise UndecodableError("no x, y and z of floating-point types")
    order = ">" if message.bigendian else "<"
    layouts = [(named[axis][0], order + _FLOATS[named[axis][1]]) for axis in "xyz"]
    step, rows, columns = message.point_step, message.height, message.width
    if any(offset + struct.calcsize(kind) > step for offset, kind in layouts):
        raise UndecodableError("coordinates beyond a point")
    if not rows * columns:
        return []
    row_step = message.row_step if rows > 1 else columns * step
    if row_step < columns * step or len(message.data) < (rows - 1) * row_step + columns * step:
        raise UndecodableError("fewer bytes than points")
    if len(message.data) > rows * row_step:
        raise UndecidedError
    found = []
    for row in range(rows):
        for column in range(columns):
            at = row * row_step + column * step
            point = [
                rounded(struct.unpack_from(kind, message.data, at + offset)[0])
                for offset, kind in layouts
            ]
            if all(map(math.isfinite, point)) and any(point):
                found.append(point)
    return found


def scans(messages: list[tuple[int, bytes]], cdr: bool) -> list[Any]:
    """Stamps and points of messages, each with its time of recording."""
    found = []
    for time, content in messages:
        read = of_cdr(content) if cdr else of_ros1(content)
        found.append([read.stamp or time, some(points_of(read))])
    if not found:
        raise UndecodableError("no messages")
    return found
