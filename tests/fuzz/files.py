"""The files of one format: a few small ones by their names, of which some are mutated."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from deepring.errors import DeepringError

_TIME = 1_700_000_000  # seconds

#: Contents by path, relative to a folder.
Files = dict[str, bytes]

#: Changes some of the files. Returns what it did, in a few words.
Mutation = Callable[[Random, Files], str]


class UndecodableError(Exception):
    """What the independent decoder says of files that are not of the format."""


class UndecidedError(Exception):
    """The format does not say how these files are to be read."""


@contextmanager
def in_memory() -> Iterator[None]:
    """What is done with what was read: its errors need not name the file."""
    try:
        yield
    except DeepringError as error:
        error.in_memory = True  # type: ignore[attr-defined]
        raise


@dataclass(frozen=True)
class Format:
    """One format that is read, with good files of it."""

    name: str
    make: Callable[[Path], Files]
    """Good files, for a folder that they will be written to."""
    mutations: tuple[Mutation, ...]
    use: Callable[[Path], Any]
    """Read the files of a folder, and use what they hold: plain values, to compare."""
    decode: Callable[[Mapping[str, bytes]], Any] | None = None
    """The same values, without the package; raises UndecodableError and UndecidedError."""
    weight: int = 4
    """How many inputs it gets, relative to the others."""
    clean: bool = False
    """Whether using the files leaves others beside them, which are removed before the next."""
    foreign: bool = False
    """Whether others define the format: then what the decoder reads should not be refused."""


def written(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files, all of one time: caches look at it."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        os.utime(path, (_TIME, _TIME))


def read_back(folder: Path) -> Files:
    """All files of a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
