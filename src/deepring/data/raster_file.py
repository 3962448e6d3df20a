"""The SQLite file of the raster cache: what it gives is what was stored, or nothing.

Every row is checked when it is read, by its checksum and the length of its image; the columns of
the table when the file is opened; the structure of the file where SQLite meets it. Nothing reads
the whole file. A row that is not whole counts as missing. A file that is damaged, no cache, or of
another version is set aside: renamed to ``rasters.sqlite.corrupt``, and made anew.
"""

import logging
import os
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple, TypeVar

from deepring.errors import FileError
from deepring.text import printable

T = TypeVar("T")

log = logging.getLogger(__name__)

#: Rows per query; SQLite accepts only a few thousand values per query.
QUERY_ROWS = 400

_TABLE = (
    "CREATE TABLE rasters (settings BLOB, path BLOB, size INTEGER, changed_ns INTEGER, image BLOB, "
    "checksum INTEGER, PRIMARY KEY (settings, path)) WITHOUT ROWID"
)

#: Results of SQLite for a file that holds something else than it should.
_DAMAGED = {
    sqlite3.SQLITE_ERROR,  # a statement that does not suit the tables
    sqlite3.SQLITE_CORRUPT,
    sqlite3.SQLITE_NOTADB,
    sqlite3.SQLITE_FORMAT,
    sqlite3.SQLITE_SCHEMA,
    sqlite3.SQLITE_MISMATCH,
    sqlite3.SQLITE_CONSTRAINT,
}
_CUT_SHORT = {sqlite3.SQLITE_IOERR_SHORT_READ, sqlite3.SQLITE_IOERR_CORRUPTFS}


class RasterKey(NamedTuple):
    """Key of a row, and the size and modification time of its scan file."""

    settings: bytes
    path: str
    size: int
    changed_ns: int

    @property
    def columns(self) -> tuple[bytes, bytes, int, int]:
        """The values as a row holds them."""
        return self.settings, os.fsencode(self.path), self.size, self.changed_ns

    def checksum(self, image: bytes) -> int:
        """CRC-32 over a whole row."""
        return zlib.crc32(image, zlib.crc32(repr(self.columns).encode()))


class RasterFile:
    """The file at ``path``, created if missing, with its folder.

    Raises FileError where it cannot be made, read or written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._identity: tuple[int, int] | None = None  # of the file that is open
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(
                f"raster cache: folder {path.parent} cannot be created ({error.strerror}); "
                "choose another one"
            ) from error

    def find(self, keys: Sequence[RasterKey], length: int) -> list[bytes | None]:
        """The images of the keys, of ``length`` bytes; None for missing or outdated ones.

        Says how many rows are not whole.
        """
        images, damaged = self._attempt(lambda database: _find(database, keys, length))
        if damaged:
            log.warning(
                "raster cache: %d damaged rasters in %s: they are made again",
                damaged,
                printable(str(self.path)),
            )
        return images

    def store(self, rows: Iterable[tuple[RasterKey, bytes]]) -> None:
        """Store images by their keys, in one transaction."""
        values = [(*key.columns, image, key.checksum(image)) for key, image in rows]

        def insert(database: sqlite3.Connection) -> None:
            with database:
                database.executemany(
                    "INSERT OR REPLACE INTO rasters VALUES (?, ?, ?, ?, ?, ?)", values
                )

        self._attempt(insert)

    def _attempt(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do it with the file; if that is damaged, set it aside and do it with a new one."""
        try:
            try:
                return self._do(work)
            except UnicodeDecodeError:
                pass  # text of the file, such as a table's name
            except sqlite3.DatabaseError as error:
                if not _is_damage(error, self.path):
                    raise
            self._set_aside()
            return self._do(work)
        except (sqlite3.Error, OSError) as error:
            full = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
            why = " (no space is left on the disk)" if full else ""
            raise FileError(
                f"raster cache: {self.path} cannot be read or written{why}; expected a file of its "
                "own in a folder that can be written; choose another folder, or delete the file"
            ) from error

    def _do(self, work: Callable[[sqlite3.Connection], T]) -> T:
        with closing(sqlite3.connect(self.path, timeout=60.0)) as database:
            self._identity = _identity(self.path)
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute(_TABLE.replace("TABLE", "TABLE IF NOT EXISTS", 1))
            tables = database.execute("SELECT name, sql FROM sqlite_master").fetchall()
            if tables != [("rasters", _TABLE)]:
                raise _OtherTablesError
            return work(database)

    def _set_aside(self) -> None:
        """Rename the file, unless another process has done so, and say it."""
        if _identity(self.path) != self._identity:
            return
        aside = self.path.with_name(f"{self.path.name}.corrupt")
        with suppress(FileNotFoundError):
            self.path.with_name(f"{self.path.name}-journal").unlink()
        self.path.replace(aside)
        log.warning(
            "raster cache: %s is damaged, or of another version: it is now %s, which can be "
            "deleted, and rasters are made anew",
            printable(str(self.path)),
            aside.name,
        )


class _OtherTablesError(sqlite3.DatabaseError):
    """A file with other tables than the cache has."""


def _is_damage(error: sqlite3.DatabaseError, path: Path) -> bool:
    if isinstance(error, _OtherTablesError):
        return True
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    if code == sqlite3.SQLITE_READONLY:  # the file says so, if the system does not
        return os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)
    return code & 0xFF in _DAMAGED or code in _CUT_SHORT


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return status.st_dev, status.st_ino


def _find(
    database: sqlite3.Connection, keys: Sequence[RasterKey], length: int
) -> tuple[list[bytes | None], int]:
    """The images, and the number of rows that are not whole."""
    images: list[bytes | None] = []
    damaged = 0
    for start in range(0, len(keys), QUERY_ROWS):
        part = keys[start : start + QUERY_ROWS]
        values = ", ".join(["(?, ?)"] * len(part))
        entries = {
            (settings, path): (size, changed, image, checksum)
            for settings, path, size, changed, image, checksum in database.execute(
                f"SELECT * FROM rasters WHERE (settings, path) IN (VALUES {values})",
                [value for key in part for value in key.columns[:2]],
            )
        }
        for key in part:
            entry = entries.get(key.columns[:2])
            image = None
            if entry is not None and _is_whole(key, entry, length):
                image = entry[2] if entry[:2] == key.columns[2:] else None
            elif entry is not None:
                damaged += 1
            images.append(image)
    return images, damaged


def _is_whole(key: RasterKey, entry: Sequence[object], length: int) -> bool:
    """Whether a row of the key, which may be outdated, is as it was stored."""
    size, changed, image, checksum = entry
    if not isinstance(image, bytes) or not isinstance(size, int) or not isinstance(changed, int):
        return False
    stored = key._replace(size=size, changed_ns=changed)
    return len(image) == length and checksum == stored.checksum(image)
