"""Reads text files: UTF-8, with or without a byte order mark, and any line ends."""

import errno
import stat
from pathlib import Path
from typing import TextIO

from deepring.errors import FileError
from deepring.io.git_lfs import LFS_POINTER, is_lfs_pointer

_MARKS = (b"\xff\xfe", b"\xfe\xff", b"\x00\x00\xfe\xff")  # of UTF-16 and UTF-32


def open_text(path: Path) -> TextIO:
    """Open a text file to read lines; a byte order mark is left out, line ends become newlines.

    Raises OSError for a file that cannot be opened; reading raises UnicodeDecodeError for a file
    that is not UTF-8: see `text_problem`.
    """
    _expect_regular(path)
    return path.open(encoding="utf-8-sig")


def read_text(path: Path, expected: str) -> str:
    """The text of a file.

    Raises FileError for a file that cannot be read or is not UTF-8, with ``expected``, what the
    file should hold.
    """
    try:
        with open_text(path) as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{path}: {text_problem(path)}; expected {expected}") from error
    if "\0" in text or is_lfs_pointer(text.encode()):
        raise FileError(f"{path}: {text_problem(path)}; expected {expected}")
    return text


def text_problem(path: Path) -> str | None:
    """The reason why a file cannot be read as text, or None."""
    try:
        _expect_regular(path)
        head = path.read_bytes()
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    if is_lfs_pointer(head):
        return LFS_POINTER
    if _is_utf16(head):
        return "is UTF-16 text: save it as UTF-8"
    if b"\0" in head:
        return "is not text"
    try:
        head.decode("utf-8")
    except UnicodeDecodeError:
        return "is not text in UTF-8"
    return None


def _expect_regular(path: Path) -> None:
    """Raise OSError for a device or a pipe, which may have no end."""
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "a device or a pipe")


def _is_utf16(content: bytes) -> bool:
    """Whether bytes are UTF-16 or UTF-32, with a byte order mark or of plain characters."""
    if content.startswith(_MARKS):
        for encoding in ("utf-32", "utf-16"):
            try:
                content.decode(encoding)
            except UnicodeDecodeError:
                continue
            return True
        return False
    start = content[:256]
    zeros = [k for k, byte in enumerate(start) if not byte]
    half = len(start) // 2
    return half > 1 and len(zeros) >= half - 2 and len({k % 2 for k in zeros}) == 1
