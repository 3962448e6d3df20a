"""Scans from ROS 1 and ROS 2 bags, one message at a time."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from deepring.checks import count
from deepring.data.scans.point_cloud2 import cloud_points
from deepring.data.session import Points
from deepring.errors import BrokenScanError, ConfigError, DataError, DeepringError, FileError

#: Endings of files that are bags.
BAGS = (".bag", ".db3", ".mcap")

_CLOUD = "sensor_msgs/msg/PointCloud2"


class BagScan(NamedTuple):
    """One message of a bag."""

    stamp: int
    """Nanoseconds, from the message's header, or from the recording if that is 0."""
    points: Points
    """(n, 3) float32, metres, in the sensor's frame."""


def is_bag(path: Path) -> bool:
    """True for a bag, by the file's ending or the folder's metadata.yaml."""
    if not path.is_dir():
        return path.suffix in BAGS
    metadata = path / "metadata.yaml"
    return metadata.is_file() and b"rosbag2_bagfile_information" in metadata.read_bytes()


def bag_scans(path: Path | str, topic: str | None = None, every: int = 1) -> Iterator[BagScan]:
    """The point clouds of a bag in the order of recording, one in memory at a time.

    Args:
        path: a .bag file of ROS 1, an .mcap or .db3 file or a folder of ROS 2.
        topic: topic of type sensor_msgs/PointCloud2; optional if there is only one.
        every: yields the first message and every ``every``-th after it.

    Raises:
        BrokenScanError: a bag or a message that cannot be decoded; see `cloud_points`.
        FileError: a missing file or library.
        DataError: a bag without point clouds.
        ConfigError: an unknown topic, or several topics and none named.
    """
    path = Path(path)
    count("every", every)
    if not path.exists():
        raise FileError(f"bag {path}: no such file or folder; expected a bag of ROS 1 or 2")
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise FileError(f"bag {path}: bags need rosbags; pip install 'deepring[bags]'") from error
    # The message type has never changed. The bag's own definitions are not used: old bags have
    # none, and an invalid one of another topic would make the whole bag unreadable.
    reader: Any
    decode: Any
    if path.suffix == ".bag":
        reader, decode = Reader1, get_typestore(Stores.ROS1_NOETIC).deserialize_ros1
    else:
        reader, decode = Reader2, get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
    try:
        with reader(path) as bag:
            connections = _of_topic(path, bag.connections, topic)
            for connection, time, raw in islice(bag.messages(connections), 0, None, every):
                yield _scan(path, connection.topic, time, decode(raw, _CLOUD))
    except DeepringError:
        raise
    except Exception as error:  # the library raises many types for a damaged bag
        tool = "rosbag" if path.suffix == ".bag" else "ros2 bag"
        raise BrokenScanError(
            f"bag {path}: cannot be decoded; expected a complete bag, but this one is damaged or "
            f"cut short: copy it again, or try `{tool} reindex`"
        ) from error


def _of_topic(path: Path, connections: list[Any], topic: str | None) -> list[Any]:
    """The connections of the named topic, or of the only one with point clouds."""
    clouds = sorted({c.topic for c in connections if c.msgtype == _CLOUD})
    if not clouds:
        topics = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
        raise DataError(
            f"bag {path}: no point clouds among its topics, {', '.join(topics) or 'none'}; "
            f"expected one of type {_CLOUD}"
        )
    if topic is None and len(clouds) > 1:
        raise ConfigError(
            f"bag {path}: point clouds on {', '.join(clouds)}; expected one topic: name it",
            argument="topic",
        )
    if topic is not None and topic not in clouds:
        raise ConfigError(
            f"bag {path}: no point clouds on topic {topic}; expected {' or '.join(clouds)}",
            argument="topic",
        )
    return [c for c in connections if c.topic == (topic or clouds[0]) and c.msgtype == _CLOUD]


def _scan(path: Path, topic: str, time: int, message: Any) -> BagScan:
    stamp = message.header.stamp
    nanoseconds = int(stamp.sec) * 10**9 + int(stamp.nanosec) or time
    try:
        return BagScan(nanoseconds, cloud_points(message))
    except BrokenScanError as error:
        raise BrokenScanError(f"bag {path}, {topic} at {nanoseconds} ns: {error}") from error
