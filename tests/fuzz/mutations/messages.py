"""Point cloud messages with other sizes, fields and steps; and MCAP files around them, with right
checksums."""

import struct
from collections.abc import Callable
from dataclasses import replace
from random import Random
from zlib import crc32

from fuzz.decoders.cloud_message import CloudMessage, encoded
from fuzz.files import Files, Mutation

_COUNTS = (0, 1, 2, 3, 4, 5, 8, 40, 100, 2**16, 2**31 - 1, 2**32 - 1)


def changed_message(rng: Random, message: CloudMessage) -> tuple[CloudMessage, str]:
    """One to three fields with other values."""
    done = []
    for _ in range(rng.choice((1, 1, 2, 3))):
        name = rng.choice(
            (
                "height",
                "width",
                "fields",
                "fields",
                "bigendian",
                "point_step",
                "row_step",
                "data",
                "stamp",
            )
        )
        value = getattr(message, name)
        if name == "fields":
            value = _fields(rng, list(value))
        elif name == "data":
            value = rng.choice((value[:-1], value[:100], b"", value + bytes(8), value * 2))
        elif name == "bigendian":
            value = rng.choice((0, 1, 2, 255))
        elif name == "stamp":
            value = rng.choice((0, 1, 999_999_999, (2**31 - 1) * 10**9))
        else:
            value = rng.choice((*_COUNTS, value + 1, max(0, value - 1), value * 2, value // 2))
        message = replace(
            message,
            **{
                name: min(value, 2**32 - 1) if isinstance(value, int) and name != "stamp" else value
            },
        )
        done.append(f"{name} {value if isinstance(value, int) else ''}".strip())
    return message, ", ".join(done)


def _fields(
    rng: Random, fields: list[tuple[str, int, int, int]]
) -> list[tuple[str, int, int, int]]:
    k = rng.randrange(len(fields))
    name, offset, datatype, count = fields[k]
    kind = rng.randrange(6)
    if kind == 0:
        del fields[k]
    elif kind == 1:
        fields.insert(rng.randrange(len(fields)), fields[k])
    elif kind == 2:
        fields[k] = (
            rng.choice(("x", "y", "", "X", "intensity", "\x1b[31m", "z" * 300)),
            offset,
            datatype,
            count,
        )
    elif kind == 3:
        fields[k] = (name, rng.choice((*_COUNTS, offset + 1)), datatype, count)
    elif kind == 4:
        fields[k] = (name, offset, rng.choice((0, 1, 2, 5, 6, 7, 8, 9, 255)), count)
    else:
        fields[k] = (name, offset, datatype, rng.choice(_COUNTS))
    return fields


def forged_messages(
    name: str, messages: list[CloudMessage], write: Callable[[list[bytes]], bytes]
) -> Mutation:
    """A bag in which one message is another, and all else is right."""

    def mutate(rng: Random, files: Files) -> str:
        all_messages = list(messages)
        k = rng.randrange(len(all_messages))
        all_messages[k], done = changed_message(rng, all_messages[k])
        contents = [encoded(message, cdr=True) for message in all_messages]
        if rng.random() < 0.2:
            at = rng.randrange(len(contents[k]))
            contents[k] = (
                contents[k][:at] + rng.choice((b"", rng.randbytes(4))) + contents[k][at + 4 :]
            )
            done += ", bytes"
        files[name] = write(contents)
        return f"{name}: message {k}: {done}"

    return mutate


def mcap(contents: list[bytes], start: int) -> bytes:
    """An MCAP file of messages 0.1 s apart, three to a chunk, with all checksums."""
    text = b"sensor_msgs/msg/PointCloud2"
    schema = _record(
        3, struct.pack("<H", 1) + _string(text) + _string(b"ros2msg") + _string(b"uint8 x")
    )
    channel = _record(
        4, struct.pack("<HH", 1, 1) + _string(b"/points") + _string(b"cdr") + _string(b"")
    )
    out = b"\x89MCAP0\r\n" + _record(1, _string(b"ros2") + _string(b"fuzz"))
    indexes = b""
    for first in range(0, len(contents), 3):
        part = contents[first : first + 3]
        times = [start + (first + k) * 10**8 for k in range(len(part))]
        inner = schema + channel if first == 0 else b""
        offsets = []
        for time, content in zip(times, part, strict=True):
            offsets.append((time, len(inner)))
            inner += _record(5, struct.pack("<HIQQ", 1, 0, time, time) + content)
        head = struct.pack("<QQQI", times[0], times[-1], len(inner), crc32(inner))
        chunk = _record(6, head + _string(b"") + struct.pack("<Q", len(inner)) + inner)
        at = len(out)
        out += chunk
        entries = b"".join(struct.pack("<QQ", *pair) for pair in offsets)
        index = _record(7, struct.pack("<H", 1) + _string(entries))
        where = struct.pack("<HQ", 1, len(out))
        out += index
        indexes += _record(
            8,
            struct.pack("<QQQQ", times[0], times[-1], at, len(chunk))
            + _string(where)
            + struct.pack("<Q", len(index))
            + _string(b"")
            + struct.pack("<QQ", len(inner), len(inner)),
        )
    out += _record(15, struct.pack("<I", crc32(out)))
    chunks = -(-len(contents) // 3)
    times = (start, start + (len(contents) - 1) * 10**8)
    counts = _string(struct.pack("<HQ", 1, len(contents)))
    statistics = _record(
        11, struct.pack("<QHIIIIQQ", len(contents), 1, 1, 0, 0, chunks, *times) + counts
    )
    at, summary = len(out), schema + channel + indexes + statistics
    footer = struct.pack("<BQQQ", 2, 20, at, 0)
    return out + summary + footer + struct.pack("<I", crc32(summary + footer)) + b"\x89MCAP0\r\n"


def _record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _string(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content
