"""ROS 2's SQLite files."""

import sqlite3
from typing import Any

from fuzz.decoders.cloud_message import scans
from fuzz.files import UndecodableError


def decode(content: bytes) -> list[Any]:
    """The scans of a .db3 file, read row by row without its indexes."""
    database = sqlite3.connect(":memory:")
    try:
        database.deserialize(content)
        database.text_factory = lambda data: data.decode("utf-8", "replace")
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
