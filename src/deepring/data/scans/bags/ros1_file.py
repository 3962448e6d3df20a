"""Bags of ROS 1, version 2.0 (http://wiki.ros.org/Bags/Format/2.0), with and without an index."""

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from deepring.data.scans.bags.compression import decompressed
from deepring.data.scans.bags.fields import Blocks, Fields, size_of, text
from deepring.data.scans.bags.storage import Channel, Contents, Message, named_type
from deepring.errors import BrokenScanError, DataError

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7

_Header = dict[str, bytes]


class _Opening(NamedTuple):
    """The first record of a bag."""

    index_start: int
    """Byte where the index begins; 0 for a recording that was not closed."""
    connections: int
    chunks: int
    end: int
    """Byte after the record."""


class Ros1File:
    """One .bag file. A recording that was not closed is read up to its end."""

    repair = "rosbag reindex"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._channels: dict[int, Channel] = {}

    def contents(self) -> Contents:
        """By the index at the end, if it is sound; else by all messages."""
        try:
            counts, damage = self._index(), ""
        except BrokenScanError as error:
            counts, damage = Counter(), str(error)
            try:
                for message in self.messages():
                    counts[message.channel] += 1
            except BrokenScanError as reason:
                damage = str(reason)
        return Contents(dict(self._channels), dict(counts), damage)

    def messages(self, channels: Collection[int] | None = None) -> Iterator[Message]:
        """See `Container`; None for all channels."""
        with self.path.open("rb") as file:
            blocks = Blocks(file, size_of(self.path))
            opening = _opening(blocks)
            blocks.jump(opening.end)
            end = (
                opening.index_start
                if opening.end <= opening.index_start <= blocks.size
                else blocks.size
            )
            while blocks.offset < end:
                where = f"record at byte {blocks.offset}"
                header = _header(blocks, where)
                op = _number(header, "op", 1, where)
                (length,) = Fields(blocks.take(4), where).numbers("<I")
                if op == _CHUNK:
                    found = self._chunk(header, blocks.take(length), where)
                    yield from (m for m in found if channels is None or m.channel in channels)
                elif op == _CONNECTION:
                    self._connect(header, blocks.take(length), where)
                elif op in (_INDEX, _CHUNK_INFO):
                    blocks.skip(length)
                else:
                    raise BrokenScanError(f"{where}: of kind {op}, expected a chunk or its index")

    def _index(self) -> Counter[int]:
        """Messages of each connection by the index, which tells of the connections too."""
        counts: Counter[int] = Counter()
        connections = chunks = 0
        with self.path.open("rb") as file:
            blocks = Blocks(file, size_of(self.path))
            opening = _opening(blocks)
            if opening.index_start == 0:
                raise BrokenScanError("no index: the recording was not closed")
            if not opening.end <= opening.index_start <= blocks.size:
                raise BrokenScanError(
                    f"cut short: {blocks.size} bytes, but its index begins at byte "
                    f"{opening.index_start}"
                )
            blocks.jump(opening.index_start)
            while blocks.offset < blocks.size:
                where = f"index record at byte {blocks.offset}"
                header = _header(blocks, where)
                op = _number(header, "op", 1, where)
                (length,) = Fields(blocks.take(4), where).numbers("<I")
                data = blocks.take(length)
                if op == _CONNECTION:
                    self._connect(header, data, where)
                    connections += 1
                elif op == _CHUNK_INFO:
                    fields = Fields(data, where)
                    while fields.rest:
                        number, messages = fields.numbers("<II")
                        counts[number] += messages
                    chunks += 1
                else:
                    raise BrokenScanError(f"{where}: of kind {op}, expected a part of the index")
        if (connections, chunks) != (opening.connections, opening.chunks):
            raise BrokenScanError(
                f"{chunks} chunks and {connections} connections in its index; "
                f"expected {opening.chunks} and {opening.connections}"
            )
        return counts

    def _connect(self, header: _Header, data: bytes, where: str) -> None:
        """Take a connection in."""
        fields = Fields(data, where)
        kind = text(_pairs(fields, len(data), where).get("type", b""))
        number = _number(header, "conn", 4, where)
        self._channels[number] = Channel(
            _topic(text(header.get("topic", b""))), named_type(kind), "ros1"
        )

    def _chunk(self, header: _Header, data: bytes, where: str) -> list[Message]:
        """The messages of a chunk, by time."""
        size = _number(header, "size", 4, where)
        try:
            data = decompressed(text(header.get("compression", b"none")), data, size)
        except (BrokenScanError, DataError) as error:
            raise type(error)(f"{where}: {error}") from error
        fields, messages = Fields(data, where), []
        while fields.rest:
            header = _pairs(fields, fields.numbers("<I")[0], where)
            content = fields.take(fields.numbers("<I")[0])
            op = _number(header, "op", 1, where)
            if op == _CONNECTION:
                self._connect(header, bytes(content), where)
            elif op == _MESSAGE:
                number = _number(header, "conn", 4, where)
                if number not in self._channels:
                    raise BrokenScanError(f"{where}: a message of no connection")
                time = Fields(header.get("time", b""), where).numbers("<II")
                messages.append(Message(number, time[0] * 10**9 + time[1], bytes(content)))
            else:
                raise BrokenScanError(f"{where}: a record of kind {op} in a chunk")
        return sorted(messages, key=lambda message: message.time)


def _opening(blocks: Blocks) -> _Opening:
    """The opening record. Raises DataError for a bag of another kind."""
    magic = blocks.take(min(len(_MAGIC), blocks.size))
    if magic != _MAGIC:
        if magic.startswith(b"#ROSBAG V"):
            version = text(magic[9:].strip())
            raise DataError(f"of version {version}; expected 2.0: `rosbag fix` makes one of it")
        raise BrokenScanError("it does not begin as bags of ROS 1 do")
    where = "opening record"
    header = _header(blocks, where)
    if _number(header, "op", 1, where) != _BAG:
        raise BrokenScanError("its opening record is damaged")
    if header.get("encryptor"):
        raise DataError(
            f"encrypted by {text(header['encryptor'])}; expected one that is not: "
            "`rosbag decrypt` makes one"
        )
    index_start = _number(header, "index_pos", 8, where)
    connections, chunks = (_number(header, f"{name}_count", 4, where) for name in ("conn", "chunk"))
    blocks.skip(Fields(blocks.take(4), where).numbers("<I")[0])
    return _Opening(index_start, connections, chunks, blocks.offset)


def _header(blocks: Blocks, where: str) -> _Header:
    """The header of the next record."""
    (length,) = Fields(blocks.take(4), where).numbers("<I")
    return _pairs(Fields(blocks.take(length), where), length, where)


def _pairs(fields: Fields, length: int, where: str) -> _Header:
    """The next ``length`` bytes, which are fields ``name=value``."""
    inside, header = Fields(fields.take(length), where), {}
    while inside.rest:
        name, equals, value = bytes(inside.take(inside.numbers("<I")[0])).partition(b"=")
        if not equals:
            raise BrokenScanError(f"{where}: a header field without '='")
        header[text(name)] = value
    return header


def _number(header: _Header, name: str, size: int, where: str) -> int:
    value = header.get(name, b"")
    if len(value) != size:
        raise BrokenScanError(f"{where}: {len(value)} bytes of {name!r}; expected {size}")
    return int.from_bytes(value, "little")


def _topic(name: str) -> str:
    """A topic's name without repeated slashes."""
    return "/" * name.startswith("/") + "/".join(part for part in name.split("/") if part)
