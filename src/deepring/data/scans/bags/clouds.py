"""Decodes messages of point clouds."""

from collections.abc import Callable
from functools import cache
from typing import Any

from deepring.data.scans.bags.compression import ZSTD, decompressed
from deepring.data.scans.bags.topics import CLOUD
from deepring.errors import BrokenScanError, DataError, FileError


class CloudDecoder:
    """Decodes sensor_msgs/PointCloud2 of ROS 1 and ROS 2."""

    def __init__(self) -> None:
        """Raises FileError if rosbags is not installed."""
        self._decode = _decoders()

    def check(self, encoding: str) -> None:
        """Raise DataError for an encoding of messages that is not read."""
        if encoding not in self._decode:
            raise DataError(
                f"messages encoded as {encoding or 'nothing'}; expected {' or '.join(self._decode)}"
            )

    def __call__(self, encoding: str, data: bytes) -> Any:
        """The message. Raises BrokenScanError for one that cannot be decoded."""
        if data.startswith(ZSTD):  # No message begins so; metadata.yaml may be missing.
            data = decompressed("zstd", data)
        if encoding == "cdr" and data[:2] not in (b"\0\0", b"\0\1"):
            raise BrokenScanError(
                f"a message that begins with the bytes {data[:4].hex(' ')}; expected plain CDR, 00 "
                "00 or 00 01: it is damaged, or compressed"
            )
        try:
            return self._decode[encoding](data, CLOUD)
        except Exception as error:  # the library raises many types for a damaged message
            raise BrokenScanError(f"{len(data)} bytes that are no {CLOUD}") from error


@cache
def _decoders() -> dict[str, Callable[[bytes, str], Any]]:
    """The library's functions, by the encoding of messages."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise FileError("bags need rosbags; pip install 'deepring[bags]'") from error
    # The message type has never changed. The bag's own definitions are not used: old bags have
    # none, and an invalid one of another topic would make the whole bag unreadable.
    return {
        "cdr": get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr,
        "ros1": get_typestore(Stores.ROS1_NOETIC).deserialize_ros1,
    }
