"""Dataset layouts by name: open a session, list sessions, tell which layout a folder has.

A layout is one module of this package, which ends in ``READER = Reader(...)``. Modules are found
by their names and imported when they are first needed. A reader from another package is known
after `register_reader`, or by an entry point of the group ``deepring.readers``.
"""

import inspect
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from functools import cache
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

from deepring.checks import one_of
from deepring.data.readers.reader import BinaryScans, LayoutError, Reader, existing_root
from deepring.data.session import Session
from deepring.errors import ConfigError, DataError

#: The group of entry points under which other packages offer readers.
ENTRY_POINTS = "deepring.readers"

_DEPTH, _MOST_NAMES = 3, 50_000  # how far, and at how many names, a folder is looked into
_registered: dict[str, Reader] = {}


def register_reader(reader: Reader) -> None:
    """Make a reader known by its name. Raises ConfigError where the name is taken."""
    if reader.name in reader_names():
        raise ConfigError(
            f"reader.name: {reader.name!r}, expected a new name; {', '.join(reader_names())} "
            "are taken"
        )
    _registered[reader.name] = reader


def reader_names() -> list[str]:
    """The names of all layouts; none of their modules is imported."""
    return [*_own_modules(), *_entry_points(), *_registered]


def reader_of(format: str) -> Reader:
    """The reader of a layout's name. Raises ConfigError for an unknown one."""
    one_of("format", format, reader_names())
    if format in _registered:
        return _registered[format]
    if format in _own_modules():
        reader: Reader = import_module(f"{__name__}.{format}").READER
    else:
        reader = _entry_points()[format].load()
    return reader


def binary_formats() -> dict[str, BinaryScans]:
    """The kinds of .bin files, by name."""
    return {name: scans for reader in _readers() for name, scans in reader.scans.items()}


def open_session(format: str, root: Path | str, name: str | None = None, **options: Any) -> Session:
    """Open session ``name`` of the dataset in ``root``; ``name`` may be left out if it has one.

    ``options`` go to the reader: ``pose_tolerance`` (nclt, mulran), ``extrinsic`` (mulran).
    Raises ConfigError for an unknown format or option, and DataError where the session cannot be
    opened.
    """
    reader = reader_of(format)
    accepted = list(inspect.signature(reader.open).parameters)[2:]
    for option in options:
        if option not in accepted:
            raise ConfigError(
                f"option {option!r} of format {format}; expected "
                f"{'one of ' + ', '.join(accepted) if accepted else 'none'}"
            )
    if name is None:
        names = list_sessions(format, root)
        if len(names) > 1:
            raise DataError(
                f"{root} holds {len(names)} sessions ({', '.join(names)}): name one",
                argument="name",
            )
        name = names[0]
    try:
        with _layouts_named(reader):
            return reader.open(root, name, **options)
    except DataError as error:
        names = reader.sessions(root) if Path(root).is_dir() else []
        if not names or name in names:
            raise
        raise DataError(
            f"no session {name!r} in {root}, which holds {', '.join(names)}; name one of these"
        ) from error


def list_sessions(format: str, root: Path | str) -> list[str]:
    """Names of the sessions in ``root``. Raises DataError where there is none."""
    reader = reader_of(format)
    with _layouts_named(reader):
        names = reader.sessions(root)
        if not names:
            raise LayoutError("no scans of any session", existing_root(root))
    return names


def detect_format(root: Path | str) -> str:
    """The name of the layout of the dataset in ``root``, by the names of files and folders.

    Raises DataError where it has none of the known layouts, or several.
    """
    if (name := _format_of_file(Path(root))) is not None:
        return name
    base = existing_root(root)
    guesses = _guesses(base)
    if len(guesses) == 1:
        return guesses[0]
    if guesses:
        raise DataError(
            f"{base} holds data of several formats ({', '.join(guesses)}): name the format, or "
            "give the folder of one dataset"
        )
    layouts = "\n".join(
        f"  {reader.title}: {layout}" for reader in _readers() for layout in reader.layouts
    )
    raise DataError(
        f"{base} holds no dataset of a known layout; expected root to be the folder that holds "
        f"one of these:\n{layouts}"
    )


def ground_of(session: Session, format: str) -> float:
    """z of the ground under the sensor in a session's scans, metres: the session's own value, or
    the usual one of its format. Raises DataError where neither says it."""
    ground_z = reader_of(format).ground_z if session.ground_z is None else session.ground_z
    if ground_z is None:
        raise DataError(
            f"format {format}: neither it nor session {session.name} says how high the sensor is; "
            "give ground_z"
        )
    return ground_z


@cache
def _own_modules() -> tuple[str, ...]:
    return tuple(m.name for m in pkgutil.iter_modules(__path__) if m.name != "reader")


@cache
def _entry_points() -> dict[str, Any]:
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in entry_points(group=ENTRY_POINTS)}


def _readers() -> Iterator[Reader]:
    return map(reader_of, reader_names())


@contextmanager
def _layouts_named(reader: Reader) -> Iterator[None]:
    """Add to a LayoutError which layouts are accepted, and which one the folder has."""
    try:
        yield
    except LayoutError as error:
        folder = error.root if error.root.is_dir() else None
        others = [name for name in (_guesses(folder) if folder else ()) if name != reader.name]
        advice = "".join(
            f" This looks like a {reader_of(other).title} folder: use format {other}."
            for other in others
        )
        listed = "\n".join(f"  {layout}" for layout in reader.layouts)
        raise DataError(f"{reader.title}: {error}.{advice} Accepted layouts:\n{listed}") from None


def _format_of_file(root: Path) -> str | None:
    if root.is_dir():
        return None
    return next((r.name for r in _readers() if root.suffix in r.file_endings), None)


def _guesses(root: Path) -> list[str]:
    """The layouts whose signatures lie in ``root`` or a few levels below it."""
    readers = list(_readers())
    closed = {folder for reader in readers for folder in reader.scan_folders}
    names = {root.name, *islice(_names_below(root, closed), _MOST_NAMES)}
    likely = [
        reader
        for reader in readers
        if any(fnmatch(name, pattern) for name in names for pattern in reader.signatures)
    ]
    explained = {name for reader in likely for name in reader.resembles}
    return [reader.name for reader in likely if reader.name not in explained]


def _names_below(root: Path, closed: set[str]) -> Iterator[str]:
    """The names of all files and folders below ``root``, level by level."""
    level = [root]
    for _ in range(_DEPTH + 1):
        entries = [entry for folder in level for entry in _entries(folder)]
        yield from (entry.name for entry in entries)
        level = [entry for entry in entries if entry.name not in closed and entry.is_dir()]


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:  # a folder that we may not look into tells nothing
        return []
