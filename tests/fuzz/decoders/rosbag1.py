"""Bags of ROS 1, version 2.0: by the places that their index states, or record by record."""

import bz2
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import lz4.frame

from fuzz.decoders.cloud_message import scans
from fuzz.files import UndecodableError

_MAGIC = b"#ROSBAG V2.0\n"
_CLOUD = "sensor_msgs/PointCloud2"

Fields = dict[str, bytes]


def decode(content: bytes) -> list[Any]:
    """The scans of a bag, whose chunks hold as many messages as its index states."""
    if not content.startswith(_MAGIC):
        raise UndecodableError("no bag of version 2.0")
    _, head, _ = _record(content, len(_MAGIC))
    index_at = _field(head, "index_pos", "Q")
    connections: dict[int, str] = {}
    counts: Counter[int] = Counter()
    places: list[Fields] = []
    for _, fields, data in _records(content, index_at):
        op = _field(fields, "op", "B")
        if op == 7:
            kind = _fields(data).get("type", b"").decode("latin-1")
            connections[_field(fields, "conn", "I")] = kind
        elif op == 6 and len(data) % 8 == 0:
            places.append(fields)
            for number, messages in struct.iter_unpack("<II", data):
                counts[number] += messages
        else:
            raise UndecodableError("an index of other records")
    stated = [_field(head, name, "I") for name in ("conn_count", "chunk_count")]
    if stated != [len(connections), len(places)]:
        raise UndecodableError("a header other than the index")
    clouds = {number for number, kind in connections.items() if kind == _CLOUD}
    for route in (_by_places, _by_order):
        with suppress(UndecodableError):
            messages = [m for m in route(content, places, index_at) if m[0] in clouds]
            if Counter(number for number, *_ in messages) == Counter(
                {number: counts[number] for number in clouds if counts[number]}
            ):
                messages.sort(key=lambda message: message[1])
                return scans([(time, data) for _, time, data in messages], cdr=False)
    raise UndecodableError("chunks other than the index states")


def _by_places(content: bytes, places: list[Fields], _: int) -> list[tuple[int, int, bytes]]:
    """(connection, time, content) of the messages in the chunks that the index names."""
    found = []
    for fields in places:
        _, head, data = _record(content, _field(fields, "chunk_pos", "Q"))
        found += _of_chunk(head, data)
    return found


def _by_order(content: bytes, _: list[Fields], index_at: int) -> list[tuple[int, int, bytes]]:
    """The same of all chunks before the index."""
    found = []
    for _, head, data in _records(content[:index_at], len(_MAGIC)):
        if _field(head, "op", "B") == 5:
            found += _of_chunk(head, data)
    return found


def _of_chunk(head: Fields, data: bytes) -> list[tuple[int, int, bytes]]:
    if _field(head, "op", "B") != 5:
        raise UndecodableError("no chunk where one should be")
    name, size = head.get("compression", b"none"), _field(head, "size", "I")
    return list(_chunk(_decompressed(name, data, size)))


def _decompressed(name: bytes, data: bytes, size: int) -> bytes:
    """The ``size`` bytes of a chunk."""
    if name == b"none":
        whole = data
    elif name in (b"bz2", b"lz4"):
        stream: Any = bz2.BZ2Decompressor() if name == b"bz2" else lz4.frame.LZ4FrameDecompressor()
        try:
            whole = stream.decompress(data, max_length=size + 1)
        except (OSError, ValueError, EOFError, RuntimeError) as error:
            raise UndecodableError("a chunk that is not compressed") from error
        if not stream.eof or stream.unused_data:
            raise UndecodableError("a chunk cut short or with more behind it")
    else:
        raise UndecodableError("a chunk of an unknown compression")
    if len(whole) != size:
        raise UndecodableError("a chunk of another size")
    return whole


def _chunk(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """(connection, time, content) of the messages in a chunk."""
    for _, fields, content in _records(data, 0):
        op = _field(fields, "op", "B")
        if op == 2:
            time = _field(fields, "time", "Q")
            seconds, nanoseconds = time % 2**32, time >> 32
            yield _field(fields, "conn", "I"), seconds * 10**9 + nanoseconds, content
        elif op != 7:
            raise UndecodableError("a record of another kind in a chunk")


def _record(content: bytes, at: int) -> tuple[int, Fields, bytes]:
    """The record at one place."""
    for record in _records(content, at):
        return record
    raise UndecodableError("no record where one should be")


def _records(content: bytes, at: int) -> Iterator[tuple[int, Fields, bytes]]:
    while at < len(content):
        start = at
        parts = []
        for _ in range(2):
            if at + 4 > len(content):
                raise UndecodableError("a record cut short")
            (size,) = struct.unpack_from("<I", content, at)
            at += 4 + size
            if at > len(content):
                raise UndecodableError("a record cut short")
            parts.append(content[at - size : at])
        yield start, _fields(parts[0]), parts[1]


def _fields(header: bytes) -> Fields:
    fields, at = {}, 0
    while at < len(header):
        if at + 4 > len(header):
            raise UndecodableError("a header cut short")
        (size,) = struct.unpack_from("<I", header, at)
        at += 4 + size
        name, equals, value = header[at - size : at].partition(b"=")
        if at > len(header) or not equals:
            raise UndecodableError("a header cut short")
        fields[name.decode("latin-1")] = value
    return fields


def _field(fields: Fields, name: str, kind: str) -> int:
    value = fields.get(name, b"")
    if len(value) != struct.calcsize(kind):
        raise UndecodableError(f"no {name} in a header")
    return int(struct.unpack(f"<{kind}", value)[0])
