"""MCAP files: records, chunks with checksums, and a summary."""

import struct
from collections.abc import Iterator
from typing import Any
from zlib import crc32

from fuzz.decoders.cloud_message import scans
from fuzz.files import UndecidedError, UndecodableError

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = 9 + 20  # bytes


def decode(content: bytes) -> list[Any]:
    """The scans of a file whose chunks and statistics agree with its messages.

    The checksums of the data and of the summary cover more than the scans; those of the chunks are
    compared.
    """
    if content[:8] != _MAGIC or content[-8:] != _MAGIC or len(content) < 16 + _FOOTER:
        raise UndecodableError("no whole MCAP file")
    end = len(content) - 8 - _FOOTER
    if content[end : end + 9] != struct.pack("<BQ", 2, 20):
        raise UndecodableError("no footer")
    (summary_at,) = struct.unpack_from("<Q", content, end + 9)
    data, ended = [], False
    for at, op, body in _records(content[8:end]):
        if op == 15:
            ended = True
            break
        data.append((at + 8, op, body))
    if not ended or data[0][1] != 1:
        raise UndecodableError("no header, or no end of the data")
    summary = list(_records(content[summary_at:end])) if summary_at else []
    return scans(_messages(data, [(op, body) for _, op, body in summary]), cdr=True)


def _messages(data: list[Any], summary: list[Any]) -> list[tuple[int, bytes]]:
    channels: dict[int, int] = {}
    schemas: dict[int, str] = {}
    messages: list[tuple[int, int, bytes]] = []
    chunks = []
    for at, op, body in data:
        inner = [(op, body)]
        if op == 6:
            first, last, inner = _chunk(body)
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


def _chunk(body: bytes) -> tuple[int, int, list[tuple[int, bytes]]]:
    first, last, size, crc, length = _unpack("<QQQII", body)
    compression = body[32 : 32 + length]
    (packed,) = _unpack("<Q", body[32 + length :])
    content = body[40 + length :]
    if compression:
        raise UndecidedError  # other compressions are not decoded here
    if packed != len(content) or size != packed or (crc and crc32(content) != crc):
        raise UndecodableError("a chunk of another size or checksum")
    return first, last, [(op, inner) for _, op, inner in _records(content)]


def _records(content: bytes) -> Iterator[tuple[int, int, bytes]]:
    at = 0
    while at < len(content):
        op, size = _unpack("<BQ", content[at:])
        body = content[at + 9 : at + 9 + size]
        if len(body) != size:
            raise UndecodableError("a record cut short")
        if op == 15:
            body = b""
        yield at, op, body
        at += 9 + size


def _unpack(layout: str, content: bytes) -> tuple[Any, ...]:
    if len(content) < struct.calcsize(layout):
        raise UndecodableError("a record cut short")
    return struct.unpack_from(layout, content)
