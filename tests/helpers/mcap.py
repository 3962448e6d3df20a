"""Writes MCAP files record by record, with every option of the format that matters."""

import struct
import zlib

import lz4.frame
from backports import zstd

MAGIC = b"\x89MCAP0\r\n"
PACK = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstd.compress}
CLOUD = "sensor_msgs/msg/PointCloud2"


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def record(op, content):
    return struct.pack("<BQ", op, len(content)) + content


def schema(number=1, name=CLOUD, encoding="ros2msg"):
    return record(3, struct.pack("<H", number) + text(name) + text(encoding) + text(""))


def channel(number=1, topic="/points", of=1, encoding="cdr"):
    return record(4, struct.pack("<HH", number, of) + text(topic) + text(encoding) + text(""))


def message(time, data, number=1):
    return record(5, struct.pack("<HIQQ", number, 0, time, time) + data)


def chunk(records, times, compression="", crc=True):
    data = b"".join(records)
    packed = PACK[compression](data)
    head = struct.pack("<QQQI", min(times), max(times), len(data), zlib.crc32(data) if crc else 0)
    return record(6, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


def statistics(counts, chunks=1):
    head = struct.pack("<QHIIIIQQ", sum(counts.values()), 1, len(counts), 0, 0, chunks, 0, 0)
    each = b"".join(struct.pack("<HQ", number, count) for number, count in counts.items())
    return record(11, head + struct.pack("<I", len(each)) + each)


def mcap(data, summary=b"", crc=True):
    """A file of records ``data`` and the records of its summary, closed."""
    start = MAGIC + record(1, text("ros2") + text("deepring's tests")) + data
    start += record(15, struct.pack("<I", zlib.crc32(start) if crc else 0))
    footer = struct.pack("<BQQQ", 2, 20, len(start) if summary else 0, 0)
    check = zlib.crc32(summary + footer) if crc and summary else 0
    return start + summary + footer + struct.pack("<I", check) + MAGIC
