"""Standard output and error, which take every text, whatever the locale and whoever reads them."""

import codecs
import errno
import io
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

#: The name that Python's codecs know `_plain` by.
PLAIN = "deepring.plain"

_STDERR = 2

#: ASCII in place of characters that an output's encoding lacks, where Unicode knows no other form.
_ASCII = {
    **{"°": "deg", "±": "+/-", "×": "x", "·": ".", "•": "*", "−": "-", "–": "-", "—": "-"},
    **{"‖": "||", "√": "sqrt", "‘": "'", "’": "'", "“": '"', "”": '"', "ß": "ss", "≤": "<="},
    **{"≥": ">=", "→": "->", "←": "<-", "∞": "inf", "≈": "~", "µ": "u", "ø": "o", "æ": "ae"},
}


def open_streams() -> None:
    """Let standard output and error take every text; call it at the start of a process.

    What their encoding lacks is written in ASCII, see `ascii_form`. A stream that is closed, or
    whose reader has gone, swallows what is written to it, so that the work is done all the same.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        _open_descriptor(number)
        stream = getattr(sys, name)
        if stream is None:
            mode = "w" if number else "r"
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8", errors=PLAIN))  # noqa: SIM115, PTH123
        elif number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=PLAIN)
            if stream is getattr(sys, f"__{name}__"):
                setattr(sys, name, _patient(stream))


@contextmanager
def written_out() -> Iterator[None]:
    """Write what is left at the end of the block, where an error can still be told."""
    try:
        yield
    finally:
        sys.stdout.flush()


def ascii_form(character: str) -> str:
    r"""A character in ASCII: a usual spelling, or else its escape.

    >>> "".join(map(ascii_form, "θ, 45° and ö: ━│中\udcff"))
    'theta, 45deg and o: -|\\u4e2d\\xff'
    """
    if character.isascii():
        return character
    if character in _ASCII:
        return _ASCII[character]
    if "\udc80" <= character <= "\udcff":  # a byte of a file's name that is no UTF-8
        return f"\\x{ord(character) - 0xDC00:02x}"
    name = unicodedata.name(character, "")
    if name.startswith("GREEK "):
        return _greek(name)
    if name.startswith("BOX DRAWINGS "):
        return _line(name)
    base = "".join(c for c in unicodedata.normalize("NFKD", character) if c.isascii())
    return base or character.encode("ascii", "backslashreplace").decode()


def _greek(name: str) -> str:
    letter = name.partition(" LETTER ")[2].partition(" WITH ")[0].rpartition(" ")[2].lower()
    return letter.capitalize() if " CAPITAL " in name else letter


def _line(name: str) -> str:
    across, down = ("HORIZONTAL" in name), ("VERTICAL" in name)
    return "-" if across and not down else "|" if down and not across else "+"


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(ascii_form, error.object[error.start : error.end])), error.end


codecs.register_error(PLAIN, _plain)


class _PatientFile(io.FileIO):
    """A file that swallows everything once nobody reads it, or once it could not be written."""

    def write(self, data: Any, /) -> int:
        """Write as a file does. An error of standard output is raised once, if anybody reads it."""
        try:
            return super().write(data) or 0
        except OSError as error:
            number = self.fileno()
            _to_nowhere(number)
            if number == _STDERR or error.errno in (errno.EPIPE, errno.EBADF):
                return len(data)
            raise


def _patient(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """The same stream through a `_PatientFile`."""
    file = _PatientFile(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(file),
        encoding=stream.encoding,
        errors=PLAIN,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def _open_descriptor(number: int) -> None:
    """Keep a closed one from becoming that of the next file, into which C code would print."""
    try:
        os.fstat(number)
    except OSError:
        _to_nowhere(number)


def _to_nowhere(number: int) -> None:
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere != number:
        os.dup2(nowhere, number)
        os.close(nowhere)
