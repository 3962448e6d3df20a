"""The content of a scan file, and messages about what is wrong with it."""

import mmap
from collections.abc import Callable
from pathlib import Path

from deepring.data.session import Points
from deepring.errors import BrokenScanError
from deepring.io.git_lfs import LFS_POINTER, is_lfs_pointer

#: Largest file that is read, bytes; a scan of ten million points has some 0.2 GB.
LARGEST = 1 << 31

#: A file's bytes, read or mapped.
Buffer = bytes | mmap.mmap

#: First bytes of the files named ``._NAME`` that macOS writes beside others.
_APPLE_DOUBLE = b"\x00\x05\x16\x07"


class ContentError(Exception):
    """What is wrong with the content of a file; `decoded` adds the file's name."""


def content_of(path: Path | str) -> bytes:
    """The content of a scan file.

    Raises BrokenScanError for a file that cannot be read, that is empty or larger than 2 GiB, for a
    Git LFS pointer, and for a file of macOS's metadata.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size == 0 and path.is_file():
            raise BrokenScanError(f"scan {path}: 0 bytes, an empty file; expected a scan")
        if size > LARGEST:
            raise BrokenScanError(
                f"scan {path}: {size} bytes; expected at most {LARGEST}, as one scan has"
            )
        content = path.read_bytes()
    except OSError as error:
        raise BrokenScanError(
            f"scan {path}: cannot be read ({error.strerror}); expected a scan file"
        ) from error
    if is_lfs_pointer(content):
        raise BrokenScanError(f"scan {path}: {LFS_POINTER}")
    if path.name.startswith("._") and content.startswith(_APPLE_DOUBLE):
        raise BrokenScanError(
            f"scan {path}: is a file of macOS's metadata, not a scan; leave files named ._* out"
        )
    return content


def decoded(path: Path | str, parse: Callable[[bytes], Points], kind: str) -> Points:
    """What ``parse`` makes of the content of a file.

    ``kind`` names the format in messages. Raises BrokenScanError with each `ContentError`, and as
    `content_of`.
    """
    content = content_of(path)
    try:
        return parse(content)
    except ContentError as error:
        raise BrokenScanError(f"scan {path}: {error}; expected a complete {kind} file") from None
