"""Scans from ROS 1 and ROS 2 bags, one message at a time."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from deepring.checks import count
from deepring.data.scans.bags.clouds import CloudDecoder
from deepring.data.scans.bags.opening import CONTAINERS, Bag, advice, open_bag
from deepring.data.scans.bags.topics import CLOUD, cloud_topic
from deepring.data.scans.names import ending_of
from deepring.data.scans.point_cloud2 import cloud_records
from deepring.data.scans.point_times import TimedPoints, point_times
from deepring.data.scans.returns import is_return, scan_from
from deepring.data.session import Points
from deepring.errors import BrokenScanError, DeepringError, FileError

#: Endings of files that are bags.
BAGS = tuple(CONTAINERS)


class BagScan(NamedTuple):
    """One message of a bag."""

    stamp: int
    """Nanoseconds, from the message's header, or from the recording if that is 0."""
    read: Callable[[], Points]
    """Its points, (n, 3) float32, metres, in the sensor's frame; raises BrokenScanError."""
    timed: Callable[[], TimedPoints]
    """The same with the times of the points."""


def is_bag(path: Path) -> bool:
    """True for a bag, by the file's ending or the folder's metadata.yaml."""
    if not path.is_dir():
        return ending_of(path) in BAGS
    metadata = path / "metadata.yaml"
    return metadata.is_file() and b"rosbag2_bagfile_information" in metadata.read_bytes()


def bag_scans(path: Path | str, topic: str | None = None, every: int = 1) -> Iterator[BagScan]:
    """The point clouds of a bag in the order of recording, one in memory at a time.

    All messages are counted: less than the bag's index or metadata.yaml says is an error, after
    the scans before the damage. A message that is broken by itself is an error of its
    `BagScan.read`, and the next one follows.

    Args:
        path: a .bag file of ROS 1, an .mcap or .db3 file or a folder of ROS 2.
        topic: topic of type sensor_msgs/PointCloud2; optional if there is only one.
        every: yields the first message and every ``every``-th after it.

    Raises:
        BrokenScanError: a bag that is damaged or was not closed; says how much of it was read.
        FileError: a missing file or library, or no permission.
        DataError: a bag without point clouds, or in a form that is not read.
        ConfigError: an unknown topic, or several topics and none named.
    """
    path = Path(path)
    count("every", every)
    with ExitStack() as opened, _naming(path):
        yield from _scans(open_bag(path, opened), path, topic, every)


def bag_length(path: Path | str, topic: str | None = None) -> int:
    """The number of point clouds of a bag, as its index or metadata.yaml says.

    Raises as `bag_scans` does, but for damage that only reading shows.
    """
    path = Path(path)
    with ExitStack() as opened, _naming(path):
        bag = open_bag(path, opened)
        return bag.topics[_topic(bag, topic), CLOUD]


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the bag in errors."""
    if not path.exists():
        raise FileError(f"bag {path}: no such file or folder; expected a bag of ROS 1 or 2")
    try:
        yield
    except OSError as error:
        raise FileError(f"bag {path}: cannot be read: {error.strerror}") from error
    except DeepringError as error:
        raise type(error)(f"bag {path}: {error}", error.argument) from error


def _scans(bag: Bag, path: Path, topic: str | None, every: int) -> Iterator[BagScan]:
    """See `bag_scans`; the errors do not name the bag."""
    decoder = CloudDecoder()
    name = _topic(bag, topic)
    expected = bag.topics[name, CLOUD]
    read = 0
    for part in bag.parts:
        channels = {
            number: channel.encoding
            for number, channel in part.contents.channels.items()
            if (channel.topic, channel.type) == (name, CLOUD)
        }
        for encoding in channels.values():
            decoder.check(encoding)
        try:
            for message in part.file.messages(channels):
                if read % every == 0:
                    encoding = channels[message.channel]
                    decode = partial(decoder, encoding, message.data)
                    yield _scan(decode, encoding, message.time, f"bag {path}, {name}")
                read += 1
            damage = part.contents.damage
        except BrokenScanError as error:
            damage = str(error)
        if damage:
            of = f" of {expected}" if bag.counted else ""
            rest = "" if bag.counted else "; how many more there were is unknown"
            file = f"{part.file.path.name}: " if len(bag.parts) > 1 else ""
            raise BrokenScanError(
                f"{read}{of} messages on {name} read{rest}: {file}{damage}. {advice(part.file)}"
            )
    if read != expected:
        raise BrokenScanError(
            f"{read} messages on {name} read, but its index says {expected}. "
            f"{advice(bag.parts[-1].file)}"
        )


def _topic(bag: Bag, topic: str | None) -> str:
    """The topic to read. If there is none because the bag is damaged, the error says so."""
    try:
        return cloud_topic(bag.topics, topic)
    except DeepringError:
        for part in bag.parts:
            if part.contents.damage:
                raise BrokenScanError(
                    f"no messages read: {part.contents.damage}. {advice(part.file)}"
                ) from None
        raise


def _scan(decode: Callable[[], Any], encoding: str, time: int, source: str) -> BagScan:
    """The scan of one message; if it cannot be decoded, its stamp is that of the recording."""
    try:
        message = decode()
        seconds = int(message.header.stamp.sec)
        if encoding == "ros1":  # unsigned there, which the library does not tell
            seconds %= 2**32
        stamp = seconds * 10**9 + int(message.header.stamp.nanosec) or time
    except BrokenScanError as error:
        fail = partial(_fail, f"{source} at {time} ns: {error}")
        return BagScan(time, fail, fail)
    where = f"{source} at {stamp} ns"
    return BagScan(stamp, partial(_points, message, where), partial(_timed, message, stamp, where))


def _fail(reason: str) -> NoReturn:
    raise BrokenScanError(reason)


def _points(message: Any, source: str) -> Points:
    return scan_from(_records(message, source), source).points


def _timed(message: Any, stamp: int, source: str) -> TimedPoints:
    records = _records(message, source)
    points = scan_from(records, source).points
    return TimedPoints(points, point_times(message, is_return(records), stamp))


def _records(message: Any, source: str) -> Points:
    try:
        return cloud_records(message)
    except BrokenScanError as error:
        raise BrokenScanError(f"{source}: {error}") from error
