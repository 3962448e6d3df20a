"""ROS bags: records of ROS 1 bags and of MCAP files, and tables of ROS 2's SQLite files."""

import bz2
import sqlite3
import struct
from collections.abc import Iterator
from typing import Any
from zlib import crc32

import lz4.frame

from fuzz.decoders import cloud_message
from fuzz.decoders.points import some
from fuzz.files import UndecidedError, UndecodableError

Messages = list[tuple[int, bytes]]
"""Time of recording, and the content."""

_CLOUD = "sensor_msgs/PointCloud2"
_MAGIC = b"\x89MCAP0\r\n"


def scans(messages: Messages, cdr: bool) -> list[Any]:
    """Stamps and points of all messages."""
    found = []
    for time, content in messages:
        read = cloud_message.of_cdr(content) if cdr else cloud_message.of_ros1(content)
        found.append([read.stamp or time, some(cloud_message.points_of(read))])
    if not found:
        raise UndecodableError("no messages")
    return found


def rosbag1(content: bytes) -> list[Any]:
    """The scans of a bag of ROS 1, whose chunks hold as many messages as it states."""
    magic = b"#ROSBAG V2.0\n"
    if not content.startswith(magic):
        raise UndecodableError("no bag of version 2.0")
    head: dict[str, bytes] = {}
    connections: dict[int, str] = {}
    chunks: list[list[tuple[int, int, bytes]]] = []
    positions, infos, index_at = [], {}, None
    for at, fields, data in _records(content, len(magic)):
        op = _field(fields, "op", "B")
        if op == 3:
            head = fields
        elif op == 5:
            size = _field(fields, "size", "I")
            whole = _decompressed(fields.get("compression", b"none"), data, size)
            chunks.append(list(_chunk(whole)))
            positions.append(at)
        elif op == 4 and chunks:
            continue  # the index of the chunk, which is read whole
        elif op == 7:
            index_at = at if index_at is None else index_at
            inner = _fields(data)
            connections[_field(fields, "conn", "I")] = inner.get("type", b"").decode("latin-1")
        elif op == 6:
            if len(data) != 8 * _field(fields, "count", "I"):
                raise UndecodableError("a chunk info of another size")
            infos[_field(fields, "chunk_pos", "Q")] = dict(struct.iter_unpack("<II", data))
        else:
            raise UndecodableError("a record of an unknown kind")
    stated = [
        _field(head, "index_pos", "Q"),
        *(_field(head, k, "I") for k in ("conn_count", "chunk_count")),
    ]
    if stated != [index_at, len(connections), len(chunks)] or sorted(infos) != positions:
        raise UndecodableError("a header other than the records")
    messages = []
    for position, chunk in zip(positions, chunks, strict=True):
        counts = {number: 0 for number, kind in connections.items() if kind == _CLOUD}
        stated = {number: infos[position].get(number, 0) for number in counts}
        for connection, *_ in chunk:
            if connection in counts:
                counts[connection] += 1
        if counts != stated:
            raise UndecodableError("a chunk info other than the chunk")
        messages += [(time, data) for connection, time, data in chunk if connection in counts]
    messages.sort(key=lambda message: message[0])
    return scans(messages, cdr=False)


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


def _records(content: bytes, at: int) -> Iterator[tuple[int, dict[str, bytes], bytes]]:
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


def _fields(header: bytes) -> dict[str, bytes]:
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


def _field(fields: dict[str, bytes], name: str, kind: str) -> int:
    value = fields.get(name, b"")
    if len(value) != struct.calcsize(kind):
        raise UndecodableError(f"no {name} in a header")
    return int(struct.unpack(f"<{kind}", value)[0])


def mcap(content: bytes) -> list[Any]:
    """The scans of an MCAP file whose chunks and statistics agree with its messages."""
    if content[:8] != _MAGIC or content[-8:] != _MAGIC or len(content) < 45:
        raise UndecodableError("no whole MCAP file")
    records = list(_mcap_records(content[8:-8]))
    footers = [(at, body) for at, op, body in records if op == 2]
    if len(footers) != 1 or len(footers[0][1]) != 20 or records[-1][1] != 2 or records[0][1] != 1:
        raise UndecodableError("no header and footer")
    # The checksums of the data and of the summary cover more than the scans; those of the chunks
    # are compared.
    (summary_at,) = struct.unpack_from("<Q", footers[0][1])
    data, summary, ended = [], [], False
    for at, op, body in records:
        if op == 15:
            ended = True
        elif summary_at and at + 8 >= summary_at:
            summary.append((op, body))
        elif op != 2:
            data.append((at + 8, op, body))
    if not ended:
        raise UndecodableError("no end of the data")
    return scans(_mcap_messages(data, summary), cdr=True)


def _mcap_messages(data: list[Any], summary: list[Any]) -> Messages:
    channels: dict[int, int] = {}
    schemas: dict[int, str] = {}
    messages: list[tuple[int, int, bytes]] = []
    chunks = []
    for at, op, body in data:
        inner = [(op, body)]
        if op == 6:
            first, last, inner = _mcap_chunk(body)
            chunks.append(at)
        for kind, content in inner:
            if kind == 5:
                channel, _, time, _ = _unpack("<HIQQ", content)
                if op == 6 and not first <= time <= last:
                    raise UndecodableError("a message beyond the time of its chunk")
                messages.append((time, channel, content[22:]))
            _describe(kind, content, schemas, channels)
    if any(op in (3, 4) for op, _ in summary):
        channels, schemas = {}, {}
        for op, body in summary:
            _describe(op, body, schemas, channels)
    for op, body in summary:
        if op == 11 and _unpack("<QHIIIIQQ", body)[0] != len(messages):
            raise UndecodableError("statistics of another number of messages")
    listed = [_unpack("<QQQ", body)[2] for op, body in summary if op == 8]
    if listed and sorted(listed) != chunks:
        raise UndecodableError("an index of other chunks")
    messages.sort(key=lambda message: message[0])
    kind = "sensor_msgs/msg/PointCloud2"
    return [(time, body) for time, c, body in messages if schemas.get(channels.get(c, 0)) == kind]


def _describe(op: int, body: bytes, schemas: dict[int, str], channels: dict[int, int]) -> None:
    if op == 3:
        number, size = _unpack("<HI", body)
        schemas[number] = body[6 : 6 + size].decode("latin-1")
    elif op == 4:
        number, schema = _unpack("<HH", body)
        channels[number] = schema


def _mcap_chunk(body: bytes) -> tuple[int, int, list[tuple[int, bytes]]]:
    first, last, size, crc, length = _unpack("<QQQII", body)
    compression = body[32 : 32 + length]
    (packed,) = _unpack("<Q", body[32 + length :])
    content = body[40 + length :]
    if compression:
        raise UndecidedError  # other compressions are not decoded here
    if packed != len(content) or size != packed or (crc and crc32(content) != crc):
        raise UndecodableError("a chunk of another size or checksum")
    return first, last, [(op, inner) for _, op, inner in _mcap_records(content)]


def _mcap_records(content: bytes) -> Iterator[tuple[int, int, bytes]]:
    at = 0
    while at < len(content):
        op, size = _unpack("<BQ", content[at:])
        body = content[at + 9 : at + 9 + size]
        if len(body) != size or op == 0:
            raise UndecodableError("a record cut short")
        yield at, op, body
        at += 9 + size


def _unpack(layout: str, content: bytes) -> tuple[Any, ...]:
    if len(content) < struct.calcsize(layout):
        raise UndecodableError("a record cut short")
    return struct.unpack_from(layout, content)


def sqlite_bag(content: bytes) -> list[Any]:
    """The scans of a .db3 file, read row by row without its indexes."""
    database = sqlite3.connect(":memory:")
    try:
        database.deserialize(content)
        types = dict(database.execute("SELECT id, type FROM topics NOT INDEXED"))
        rows = list(
            database.execute("SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED")
        )
    # No memory: so an empty file is refused.
    except (sqlite3.Error, OverflowError, UnicodeDecodeError, MemoryError) as error:
        raise UndecodableError("no SQLite file of messages") from error
    finally:
        database.close()
    if not all(isinstance(r[2], int) and isinstance(r[3], bytes) for r in rows):
        raise UndecodableError("values of other types")
    rows.sort(key=lambda row: (row[2], row[0]))
    kind = "sensor_msgs/msg/PointCloud2"
    return scans(
        [(time, data) for _, topic, time, data in rows if types.get(topic) == kind], cdr=True
    )
