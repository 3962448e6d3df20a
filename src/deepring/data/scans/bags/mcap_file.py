"""MCAP files (https://mcap.dev/spec): every checksum and size is checked, and none is needed."""

import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from deepring.data.scans.bags.compression import decompressed
from deepring.data.scans.bags.fields import Blocks, Fields, size_of
from deepring.data.scans.bags.storage import Channel, Contents, Message, named_type
from deepring.errors import BrokenScanError, DataError

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 11, 15

#: Bytes of the footer and the magic bytes at the end.
_END = 9 + 20 + 8


class McapFile:
    """One .mcap file. A recording that was not closed is read up to its end."""

    repair = "mcap recover"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._records = _Records()

    def contents(self) -> Contents:
        """By the summary, if it is sound and has statistics; else by all messages."""
        with self.path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise BrokenScanError("it does not begin as MCAP files do")
            try:
                counts, damage = self._summary(file), ""
            except BrokenScanError as error:
                counts, damage = None, str(error)
        if counts is None:
            counts = Counter()
            try:
                for message in self.messages():
                    counts[message.channel] += 1
            except BrokenScanError as error:
                damage = str(error)
        return Contents(dict(self._records.channels), dict(counts), damage)

    def messages(self, channels: Collection[int] | None = None) -> Iterator[Message]:
        """See `Container`; None for all channels."""
        with self.path.open("rb") as file:
            blocks = Blocks(file, size_of(self.path))
            blocks.take(len(_MAGIC))
            while True:
                at, crc = blocks.offset, blocks.crc
                op, length = Fields(blocks.take(9), "").numbers("<BQ")
                where = f"record at byte {at}"
                if op == _DATA_END:
                    (expected,) = Fields(blocks.take(length), where).numbers("<I")
                    if expected not in (0, crc):
                        raise BrokenScanError("the checksum of its data is another")
                    return
                if op == _FOOTER:
                    raise BrokenScanError(f"no end of the data before byte {at}")
                if op == _CHUNK:
                    found = self._records.chunk(Fields(blocks.take(length), f"chunk at byte {at}"))
                elif op in (_SCHEMA, _CHANNEL, _MESSAGE):
                    found = self._records.record(op, Fields(blocks.take(length), where))
                else:
                    blocks.skip(length)
                    continue
                yield from (m for m in found if channels is None or m.channel in channels)

    def _summary(self, file: BinaryIO) -> Counter[int] | None:
        """Messages of each channel, by the statistics; None for a file without them.

        Raises BrokenScanError for a file that was not closed, or whose summary is damaged.
        """
        size = size_of(self.path)
        blocks = Blocks(file, size)
        blocks.jump(max(size - _END, 0))
        end = Fields(blocks.take(size - blocks.offset), "footer")
        if size < _END + len(_MAGIC) or bytes(end.rest[-8:]) != _MAGIC:
            raise BrokenScanError("no index at its end: it is cut short, or was not closed")
        op, length, start, _, crc = end.numbers("<BQQQI")
        if (op, length) != (_FOOTER, 20) or not (start == 0 or 8 < start <= size - _END):
            raise BrokenScanError("its footer is damaged")
        if start == 0:
            return None
        blocks.jump(start)
        summary = blocks.take(size - _END - start)
        # The checksum covers the footer up to itself.
        if crc and zlib.crc32(blocks.take(9 + 16), zlib.crc32(summary)) != crc:
            raise BrokenScanError("the checksum of its summary is another")
        return self._records.statistics(Fields(summary, "summary"))


class _Records:
    """The schemas and channels of a file, as its records tell of them."""

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self._schemas: dict[int, str] = {0: ""}

    def record(self, op: int, fields: Fields) -> list[Message]:
        """Take a schema or a channel in; the message of a message record."""
        if op == _SCHEMA:
            (number,) = fields.numbers("<H")
            self._schemas[number] = named_type(fields.text())
        elif op == _CHANNEL:
            number, schema = fields.numbers("<HH")
            if schema not in self._schemas:
                raise BrokenScanError(f"channel {number} is of schema {schema}, which is missing")
            topic, encoding = fields.text(), fields.text()
            self.channels[number] = Channel(topic, self._schemas[schema], encoding)
        elif op == _MESSAGE:
            number, _, time, _ = fields.numbers("<HIQQ")
            if number not in self.channels:
                raise BrokenScanError(f"a message of channel {number}, which is missing")
            return [Message(number, time, bytes(fields.rest))]
        return []

    def chunk(self, fields: Fields) -> list[Message]:
        """The messages of a chunk, by time."""
        start, end, size, crc = fields.numbers("<QQQI")
        compression = fields.text()
        (length,) = fields.numbers("<Q")
        where = fields.record
        try:
            data = decompressed(compression, fields.take(length), size)
        except (BrokenScanError, DataError) as error:
            raise type(error)(f"{where}: {error}") from error
        if crc and zlib.crc32(data) != crc:
            raise BrokenScanError(f"{where}: its checksum is another")
        inside, messages = Fields(data, where), []
        while inside.rest:
            op, length = inside.numbers("<BQ")
            if op not in (_SCHEMA, _CHANNEL, _MESSAGE):
                raise BrokenScanError(f"{where}: a record of kind {op} in it")
            messages += self.record(op, Fields(inside.take(length), where))
        if any(not start <= message.time <= end for message in messages):
            raise BrokenScanError(f"{where}: a message from outside its time")
        return sorted(messages, key=lambda message: message.time)

    def statistics(self, summary: Fields) -> Counter[int] | None:
        """The messages of each channel by a summary, which tells of the channels too."""
        counts: Counter[int] | None = None
        while summary.rest:
            op, length = summary.numbers("<BQ")
            fields = Fields(summary.take(length), "summary")
            if op in (_SCHEMA, _CHANNEL):
                self.record(op, fields)
            elif op == _STATISTICS:
                total = fields.numbers("<QHIIIIQQ")[0]
                each = Fields(fields.take(fields.numbers("<I")[0]), "statistics")
                counts = Counter()
                while each.rest:
                    number, counts[number] = each.numbers("<HQ")
                if sum(counts.values()) != total:
                    raise BrokenScanError("the statistics of its summary contradict themselves")
        # A summary may leave the channels out.
        return counts if counts is not None and set(counts) <= set(self.channels) else None
