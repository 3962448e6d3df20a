"""Decompresses chunks and messages of bags, never to more than was declared."""

import bz2
import shutil
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from deepring.data.scans.bags.fields import LARGEST
from deepring.errors import BrokenScanError, DataError, FileError

#: The first bytes of data compressed with zstd.
ZSTD = b"\x28\xb5\x2f\xfd"

#: The most that a compressed file may grow.
_GROWTH = 1000

_BLOCK = 2**20


def decompressed(name: str, data: bytes | memoryview, size: int | None = None) -> bytes:
    """Data compressed with ``name``: "none", "bz2", "lz4" or "zstd".

    ``size`` is that of the result, if it is known; nothing larger is made.

    Raises:
        BrokenScanError: damaged data, or of another size.
        DataError: another compression.
        FileError: a missing library.
    """
    if name in ("", "none"):
        result = bytes(data)
    else:
        if name not in _DECOMPRESSORS:
            expected = ", ".join(sorted(_DECOMPRESSORS))
            raise DataError(f"compressed with {name!r}; expected {expected}, or none")
        if size is not None and size > LARGEST:
            raise BrokenScanError(f"{size} bytes when decompressed; expected at most {LARGEST}")
        result = _grown(name, bytes(data), LARGEST if size is None else size)
    if size is not None and len(result) != size:
        raise BrokenScanError(f"{len(result)} bytes when decompressed; expected {size}")
    return result


def decompress_file(source: Path, target: Path) -> None:
    """Write the zstd-compressed ``source`` to ``target``; raises as `decompressed`."""
    free = shutil.disk_usage(target.parent).free
    left = min(free, source.stat().st_size * _GROWTH)
    with source.open("rb") as packed, target.open("wb") as file:
        stream, begun = _zstd(), False
        while block := packed.read(_BLOCK):
            while block or not (stream.needs_input or stream.eof):
                part = _decompressed_block(stream, block)
                left -= len(part)
                if left < 0:
                    raise BrokenScanError(
                        f"more than {_GROWTH} times its size when decompressed, or than the "
                        f"{free} bytes that {target.parent} has free"
                    )
                file.write(part)
                block, begun = b"", True
                if stream.eof:  # another stream may follow
                    block, stream, begun = stream.unused_data, _zstd(), False
    if begun:
        raise BrokenScanError("its zstd data is cut short")


def _decompressed_block(stream: Any, block: bytes) -> bytes:
    try:
        return stream.decompress(block, 16 * _BLOCK)
    except Exception as error:  # the library has its own types
        raise BrokenScanError("its zstd data is damaged") from error


def _grown(name: str, data: bytes, largest: int) -> bytes:
    """``data``, one or more compressed streams, decompressed to at most ``largest`` bytes."""
    parts: list[bytes] = []
    while data:
        stream = _DECOMPRESSORS[name]()
        try:
            parts.append(stream.decompress(data, largest + 1))
        except Exception as error:  # each library has its own types
            raise BrokenScanError(f"its {name} data is damaged") from error
        largest -= len(parts[-1])
        if largest < 0:
            raise BrokenScanError("more data than declared when decompressed")
        if not stream.eof:
            raise BrokenScanError(f"its {name} data is cut short")
        data = stream.unused_data or b""
    return b"".join(parts)


def _lz4() -> Any:
    try:
        from lz4.frame import LZ4FrameDecompressor
    except ImportError as error:
        raise _missing("lz4") from error
    return LZ4FrameDecompressor()


def _zstd() -> Any:
    name = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    try:
        return import_module(name).ZstdDecompressor()
    except ImportError as error:
        raise _missing("zstd") from error


def _missing(name: str) -> FileError:
    return FileError(f"compressed with {name}, which needs a library; pip install 'deepring[bags]'")


_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": _lz4,
    "zstd": _zstd,
}
