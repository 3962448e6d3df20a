"""Dataset layouts by name: opens and lists sessions, and detects the layout of a folder.

Each layout is one module of this package, which ends in ``READER = Reader(...)`` and is imported on
first use. Other packages add readers by `register_reader`, or by an entry point of the group
``deepring.readers``.
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

from deepring.checks import of_type, one_of
from deepring.data.readers.reader import BinaryScans, LayoutError, Reader, existing_root
from deepring.data.scans.names import ending_of
from deepring.data.session import Session
from deepring.errors import ConfigError, DataError

#: The group of entry points under which other packages offer readers.
ENTRY_POINTS = "deepring.readers"

_DEPTH, _MOST_NAMES = 3, 50_000  # limits of the search in a folder: levels and names
_registered: dict[str, Reader] = {}


def register_reader(reader: Reader) -> None:
    """Register a reader by its name. Raises ConfigError for an existing name, or no reader."""
    of_type("reader", reader, Reader)
    if reader.name in reader_names():
        raise ConfigError(
            f"reader.name: {reader.name!r}, expected a name other than {', '.join(reader_names())}"
        )
    _registered[reader.name] = reader


def reader_names() -> list[str]:
    """The names of all layouts, without importing their modules."""
    return [*_modules(), *_entry_points(), *_registered]


def reader_of(format: str) -> Reader:
    """The reader of a layout. Raises ConfigError for an unknown name."""
    one_of("format", format, reader_names())
    if format in _registered:
        return _registered[format]
    if format in _modules():
        reader: Reader = import_module(f"{__name__}.{format}").READER
    else:
        reader = _entry_points()[format].load()
    return reader


def binary_formats() -> dict[str, BinaryScans]:
    """The formats of .bin files, by name."""
    return {name: scans for reader in _readers() for name, scans in reader.scans.items()}


def drive_formats() -> list[str]:
    """The names of all layouts and of all formats of .bin files."""
    names = reader_names()
    return [*names, *(name for name in binary_formats() if name not in names)]


def open_session(format: str, root: Path | str, name: str | None = None, **options: Any) -> Session:
    """Open session ``name`` of the dataset in ``root``; optional if there is only one.

    ``options`` go to the reader: ``pose_tolerance`` (helipr, mulran, nclt), ``extrinsic`` (mulran).
    Raises ConfigError for an unknown format or option, and DataError if the session cannot be
    opened.
    """
    reader = reader_of(format)
    names = list(inspect.signature(reader.open).parameters)[2:]
    for option in options:
        if option not in names:
            raise ConfigError(
                f"option {option!r} of format {format}, expected "
                f"{'one of ' + ', '.join(names) if names else 'none'}"
            )
    if name is None:
        names = list_sessions(format, root)
        if len(names) > 1:
            raise DataError(
                f"{root}: {len(names)} sessions ({', '.join(names)}), expected the name of one",
                argument="name",
            )
        name = names[0]
    try:
        with _name_layouts(reader):
            return reader.open(root, name, **options)
    except DataError as error:
        names = reader.sessions(root) if Path(root).is_dir() else []
        if not names or name in names:
            raise
        raise DataError(
            f"no session {name!r} in {root}, expected one of {', '.join(names)}"
        ) from error


def list_sessions(format: str, root: Path | str) -> list[str]:
    """Names of the sessions in ``root``. Raises DataError if there are none."""
    reader = reader_of(format)
    with _name_layouts(reader):
        names = reader.sessions(root)
        if not names:
            raise LayoutError("no scans of any session", existing_root(root))
    return names


def detect_format(root: Path | str) -> str:
    """Detect the layout of the dataset in ``root`` by the names of files and folders.

    Raises DataError if no layout or several layouts match.
    """
    if (name := _format_of_file(Path(root))) is not None:
        return name
    base = existing_root(root)
    guesses = layouts_in(base)
    if len(guesses) == 1:
        return guesses[0]
    if guesses:
        raise DataError(
            f"{base}: data of several formats ({', '.join(guesses)}); name the format, or choose "
            "the folder of one dataset"
        )
    raise DataError(
        f"{base}: no dataset of a known layout; expected the folder that contains one of these:",
        lines=[f"  {reader.title}: {layout}" for reader in _readers() for layout in reader.layouts],
    )


def ground_of(session: Session, format: str) -> float:
    """z of the ground under the sensor in a session's scans, metres.

    The session's own value, or the usual one of its format; DataError without either.
    """
    ground_z = reader_of(format).ground_z if session.ground_z is None else session.ground_z
    if ground_z is None:
        raise DataError(
            f"ground_z: unknown for format {format} and session {session.name}; set it to z of the "
            "ground in the scans' frame, metres"
        )
    return ground_z


@cache
def _modules() -> tuple[str, ...]:
    return tuple(m.name for m in pkgutil.iter_modules(__path__) if m.name != "reader")


@cache
def _entry_points() -> dict[str, Any]:
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in entry_points(group=ENTRY_POINTS)}


def _readers() -> Iterator[Reader]:
    return map(reader_of, reader_names())


@contextmanager
def _name_layouts(reader: Reader) -> Iterator[None]:
    """Add to a LayoutError the accepted layouts and the likely one of the folder."""
    try:
        yield
    except LayoutError as error:
        folder = error.root if error.root.is_dir() else None
        guesses = [name for name in (layouts_in(folder) if folder else ()) if name != reader.name]
        advice = "".join(
            f" This looks like a {reader_of(name).title} folder: use format {name}."
            for name in guesses
        )
        raise DataError(
            f"{reader.title}: {error}.{advice} Accepted layouts:",
            lines=[f"  {layout}" for layout in reader.layouts],
        ) from None


def _format_of_file(root: Path) -> str | None:
    if root.is_dir():
        return None
    return next((r.name for r in _readers() if ending_of(root) in r.file_endings), None)


def layouts_in(root: Path) -> list[str]:
    """The layouts with signatures in ``root`` or a few levels below it."""
    readers = list(_readers())
    scan_folders = {folder for reader in readers for folder in reader.scan_folders}
    names = {root.name, *islice(_names_below(root, scan_folders), _MOST_NAMES)}
    matches = [
        reader
        for reader in readers
        if any(fnmatch(name, pattern) for name in names for pattern in reader.signatures)
    ]
    similar = {name for reader in matches for name in reader.resembles}
    return [reader.name for reader in matches if reader.name not in similar]


def _names_below(root: Path, scan_folders: set[str]) -> Iterator[str]:
    """The names of files and folders below ``root``, level by level, except in scan folders."""
    level = [root]
    for _ in range(_DEPTH + 1):
        entries = [entry for folder in level for entry in _entries(folder)]
        yield from (entry.name for entry in entries)
        level = [entry for entry in entries if entry.name not in scan_folders and _is_folder(entry)]


def _is_folder(entry: Path) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # e.g. a link that may not be followed
        return False


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:  # e.g. a folder without permission to read
        return []
