"""Small ROS bags with point clouds, and their messages."""

from types import SimpleNamespace

import numpy as np
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

KINDS = ("bag", "mcap", "db3", "folder")
CLOUD, STRING = "sensor_msgs/msg/PointCloud2", "std_msgs/msg/String"
START = 1_700_000_000_000_000_000


def message(points, width=4, big=False, before=0, after=0, row_padding=0, rows=1):
    """A PointCloud2 of points (n, 3), as plain fields; ``width`` is that of a coordinate."""
    step = before + 3 * width + after
    kind = np.dtype({4: "f4", 8: "f8"}[width]).newbyteorder(">" if big else "<")
    raw = np.full((len(points), step), 0xA5, np.uint8)
    raw[:, before : before + 3 * width] = np.ascontiguousarray(points, kind).view(np.uint8)
    columns = len(points) // rows
    lines = np.full((rows, columns * step + row_padding), 0x5A, np.uint8)
    lines[:, : columns * step] = raw.reshape(rows, -1)
    datatype = {4: 7, 8: 8}[width]
    fields = [
        SimpleNamespace(name=name, offset=before + k * width, datatype=datatype, count=1)
        for k, name in enumerate("xyz")
    ]
    return SimpleNamespace(
        fields=fields,
        height=rows,
        width=columns,
        is_bigendian=big,
        point_step=step,
        row_step=lines.shape[1],
        data=lines.ravel(),
    )


def encoded(content, at):
    """The bytes of a ROS 2 message with the stamp ``at``, nanoseconds."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    return bytes(store.serialize_cdr(_typed(store, "mcap", content, at), CLOUD))


def describe(path, start, count, topic="/points"):
    """Write metadata.yaml beside an mcap file of clouds; rosbags 0.10 reads none without it."""
    kind = {"name": topic, "type": CLOUD, "serialization_format": "cdr", "offered_qos_profiles": ""}
    metadata = {
        "version": 5,
        "storage_identifier": "mcap",
        "relative_file_paths": [path.name],
        "starting_time": {"nanoseconds_since_epoch": start},
        "duration": {"nanoseconds": 10**10},
        "message_count": count,
        "compression_format": "",
        "compression_mode": "",
        "topics_with_message_count": [{"topic_metadata": kind, "message_count": count}],
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": metadata})
    (path.parent / "metadata.yaml").write_text(text)


def write_bag(folder, kind, topics, stamped=True, compression=None, mode=None, at=None):
    """A bag of ``topics``, name -> messages or texts, one every 0.1 s; its path.

    ``compression`` is that of the chunks of ROS 1; ``mode`` is "message" or "file", in ROS 2.
    ``at`` are the stamps of the headers, nanoseconds.
    """
    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    encode = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
    if kind == "bag":
        path = folder / "drive.bag"
        writer = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    else:
        path = folder / "drive"
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if mode:
            writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with writer:
        for topic, contents in topics.items():
            msgtype = STRING if contents and isinstance(contents[0], str) else CLOUD
            connection = writer.add_connection(topic, msgtype, typestore=store)
            for number, content in enumerate(contents):
                written = START + number * 10**8
                stamp = written if at is None else at[number]
                ready = _typed(store, kind, content, stamp if stamped else 0)
                writer.write(connection, written + 7, encode(ready, msgtype))
    return path / f"drive.{kind}" if kind in ("mcap", "db3") else path


def _typed(store, kind, content, at):
    types = store.types
    if isinstance(content, str):
        return types[STRING](content)
    stamp = types["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
    sequence = (0,) if kind == "bag" else ()
    header = types["std_msgs/msg/Header"](*sequence, stamp, "lidar")
    field = types["sensor_msgs/msg/PointField"]
    fields = [field(f.name, f.offset, f.datatype, f.count) for f in content.fields]
    rest = (content.is_bigendian, content.point_step, content.row_step, content.data, True)
    return types[CLOUD](header, content.height, content.width, fields, *rest)
