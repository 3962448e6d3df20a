"""Formats with planted faults, by which the suite itself is tested: each must come out as bad."""

import ctypes
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

from deepring.errors import FileError
from fuzz.files import Files, Format

_FILE = "a.txt"
_GOOD = b"good"


def every_format() -> Iterator[Format]:
    """One for each kind of outcome, by its name."""
    for name, use in _USES.items():
        yield Format(
            name,
            lambda _: {_FILE: _GOOD},
            (_spoilt,),
            lambda folder, use=use: _read(folder / _FILE, use),
            None if name in _UNDECODED else _decoded,
            foreign=True,
        )


def _spoilt(rng: Random, files: Files) -> str:
    files[_FILE] = b"bad %d" % rng.randrange(10**6)
    return "spoilt"


def _read(path: Path, use: Any) -> str:
    content = path.read_bytes()
    return _GOOD.decode() if content == _GOOD else use(path, content.decode())


def _decoded(files: Mapping[str, bytes]) -> str:
    return files[_FILE].decode()


def _same(path: Path, text: str) -> str:
    return text


def _good(path: Path, text: str) -> str:
    return _GOOD.decode()


def _other(path: Path, text: str) -> str:
    return text.upper()


def _fail(path: Path, text: str) -> str:
    raise KeyError(text)


class _RawError(FileError):
    """Its words are not escaped, as those of other errors are."""

    raw = ""

    def __str__(self) -> str:
        return str(self.raw)


def _refuse(words: str) -> Callable[[Path, str], str]:
    def refuse(path: Path, text: str) -> str:
        error = _RawError()
        error.raw = words.format(path=path)
        raise error

    return refuse


def _hang(path: Path, text: str) -> str:
    while True:
        try:
            sum(range(1000))
        except Exception:
            continue


def _take_memory(path: Path, text: str) -> str:
    return str(len(bytearray(1 << 34)))


def _hide_memory(path: Path, text: str) -> str:
    try:
        return _take_memory(path, text)
    except MemoryError as error:
        raise FileError(f"{path}: is damaged") from error


def _quote(path: Path, text: str) -> str:
    try:
        return str(int(text))
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None


def _warn(path: Path, text: str) -> str:
    warnings.warn("careful", stacklevel=1)
    return text


def _crash(path: Path, text: str) -> str:
    ctypes.string_at(0)
    return text


_USES: dict[str, Callable[[Path, str], str]] = {
    "right": _same,
    "unchecked": _same,
    "as before": _good,
    "refused": _refuse("{path}: is damaged; expected a word"),
    "stricter": _refuse("{path}: is damaged; expected a word"),
    "exception": _fail,
    "wrong": _other,
    "wrong, as before": _good,
    "warning": _warn,
    "hang": _hang,
    "memory": _take_memory,
    "memory, hidden": _hide_memory,
    "message, without the file": _refuse("is damaged"),
    "message of lines": _refuse("{path}: is\ndamaged"),
    "message with colours": _refuse("{path}: \x1b[31m damaged"),
    "message of a library": _quote,
    "crash": _crash,
}

#: Those whose files no decoder reads.
_UNDECODED = ("unchecked", "as before", "refused")
