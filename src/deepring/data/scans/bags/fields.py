"""Reads records of known sizes, and refuses sizes that the data does not have."""

import struct
import zlib
from pathlib import Path
from typing import BinaryIO

from deepring.errors import BrokenScanError

#: The largest record or message that is read, bytes: 2.5 times a scan of 20 million points.
LARGEST = 2**30

_BLOCK = 2**20


class Fields:
    """The fields of one record in memory, from first to last."""

    def __init__(self, data: bytes | memoryview, record: str) -> None:
        self.rest = memoryview(data)
        self.record = record

    def take(self, size: int) -> memoryview:
        """The next ``size`` bytes. Raises BrokenScanError if there are fewer."""
        if size > len(self.rest):
            raise BrokenScanError(
                f"{self.record}: a field of {size} bytes, but only {len(self.rest)} are left"
            )
        taken, self.rest = self.rest[:size], self.rest[size:]
        return taken

    def numbers(self, form: str) -> tuple[int, ...]:
        """The next numbers, in the form of `struct`."""
        return struct.unpack(form, self.take(struct.calcsize(form)))

    def text(self) -> str:
        """A string after its length (4 bytes, little-endian)."""
        return text(bytes(self.take(self.numbers("<I")[0])))


class Blocks:
    """A file, read forwards. Keeps the CRC-32 of what has been read."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self.offset = 0
        self.size = size
        self.crc = 0
        self._file = file

    def take(self, size: int) -> bytes:
        """The next ``size`` bytes. Raises BrokenScanError if the file has fewer."""
        self._expect(size)
        if size > LARGEST:
            raise BrokenScanError(
                f"a record of {size} bytes at byte {self.offset}; expected at most {LARGEST}"
            )
        data = self._file.read(size)
        if len(data) != size:
            raise BrokenScanError(f"the file became shorter while it was read: {self.offset} bytes")
        self.offset += size
        self.crc = zlib.crc32(data, self.crc)
        return data

    def skip(self, size: int) -> None:
        """Pass over the next ``size`` bytes."""
        self._expect(size)
        while size:
            self.take(step := min(size, _BLOCK))
            size -= step

    def jump(self, offset: int) -> None:
        """Continue at ``offset``; the CRC no longer covers everything."""
        self._file.seek(offset)
        self.offset = offset

    def _expect(self, size: int) -> None:
        left = self.size - self.offset
        if size > left:
            raise BrokenScanError(
                f"the file ends at byte {self.size}, {size - left} bytes before the end of the "
                f"record at byte {self.offset}"
            )


def text(data: bytes) -> str:
    """Text from a file, without characters that a terminal would obey."""
    found = data.decode("utf-8", "replace")
    return found if found.isprintable() else ascii(found)[1:-1]


def size_of(path: Path) -> int:
    """Bytes of a file."""
    return path.stat().st_size
