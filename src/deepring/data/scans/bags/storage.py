"""What the containers of bags have in common: channels, messages and how many there are."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol


class Channel(NamedTuple):
    """The messages of one topic and type."""

    topic: str
    type: str
    """As ROS 2 writes it: package/msg/Name."""
    encoding: str
    """Of its messages: "cdr" (ROS 2), "ros1" or another."""


class Message(NamedTuple):
    """One message, not decoded."""

    channel: int
    time: int
    """Of its recording, nanoseconds."""
    data: bytes


class Contents(NamedTuple):
    """What a container says that it holds."""

    channels: dict[int, Channel]
    counts: dict[int, int]
    """Messages of each channel: as the index says, or as found if there is no sound index."""
    damage: str = ""
    """Why there may be more messages than ``counts`` says; empty for a sound container."""


class Container(Protocol):
    """One file with messages."""

    path: Path
    repair: str
    """The command that repairs such files."""

    def contents(self) -> Contents:
        """What it holds. Raises BrokenScanError or DataError for a file that cannot be read."""
        ...

    def messages(self, channels: Collection[int]) -> Iterator[Message]:
        """The messages of the channels, in the order of recording.

        Raises BrokenScanError where the file is damaged, after the messages before that place.
        """
        ...


def named_type(name: str) -> str:
    """A message type as ROS 2 writes it: ROS 1 leaves "msg" out."""
    package, slash, rest = name.partition("/")
    return f"{package}/msg/{rest}" if slash and "/" not in rest else name
