"""The raster cache: rasters on disk, keyed by everything that determines them.

Its SQLite file tolerates a kill during a write and several processes. The key of a row is the
raster's settings and the scan's path; a row is valid while size and modification time of the scan
file are unchanged. A BEV of 120 x 120 cells takes 1.8 kB.
"""

import hashlib
import json
import logging
import sqlite3
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, is_dataclass
from pathlib import Path

import numpy as np

from deepring.data.left_out import LeftOut
from deepring.data.packed_rasters import Rasters, pack, unpack
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DataError, FileError
from deepring.progress import Bar, Progress, progress_bar
from deepring.rasters import Raster, raster_settings

log = logging.getLogger(__name__)

#: Increase this when a code change alters the rasters of the same settings.
RASTER_VERSION = 1

#: Rows per query; SQLite accepts only a few thousand values per query.
QUERY_ROWS = 400

#: Scans per transaction: the most that a kill loses, and that a second process waits for.
BATCH = 64


class RasterCache:
    """Rasterizes scans, or loads the rasters from disk.

    Args:
        folder: folder of ``rasters.sqlite``, created if missing. If several processes share it, it
            must be on a local disk, as SQLite requires.
        workers: number of threads that rasterize; compiled loops release the interpreter lock.
    """

    def __init__(self, folder: Path, workers: int = 2) -> None:
        self.path = Path(folder) / "rasters.sqlite"
        self.workers = max(1, workers)

    def load(
        self, scans: ScanSet, raster: Raster, progress: Progress | None = None
    ) -> tuple[ScanSet, Rasters, tuple[str, ...]]:
        """The readable scans, their rasters, and the reason for each unreadable scan."""
        keys = _keys(scans, raster)
        broken: list[str] = []
        with self._database() as database:
            rows = [_unless_blank(row, raster) for row in _find(database, keys)]
            missing = [k for k, row in enumerate(rows) if row is None]
            count = len(scans) - len(missing)
            if progress is not None:
                progress(count, len(scans))
            with ThreadPoolExecutor(self.workers) as pool:
                for start in range(0, len(missing), BATCH):
                    batch = missing[start : start + BATCH]
                    images = pool.map(lambda k: _rasterize(scans, k, raster), batch)
                    for k, image in zip(batch, images, strict=True):
                        if isinstance(image, BrokenScanError):
                            broken.append(str(image))
                        else:
                            rows[k] = image
                    _store(database, [(keys[k], rows[k]) for k in batch if rows[k] is not None])
                    count += len(batch)
                    if progress is not None:
                        progress(count, len(scans))
        readable = np.array([row is not None for row in rows], dtype=np.bool_)
        values = [row for row in rows if row is not None]
        dtype = np.uint8 if raster.dtype == np.bool_ else raster.dtype
        data = np.frombuffer(bytearray().join(values), dtype=dtype)
        data = data.reshape(len(values), -1 if values else 0)
        return scans.subset(readable), Rasters(data, raster), tuple(broken)

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(
                f"raster cache: folder {self.path.parent} cannot be created ({error.strerror}); "
                "choose another one"
            ) from error
        try:
            with closing(sqlite3.connect(self.path, timeout=60.0)) as database:
                database.execute(
                    "CREATE TABLE IF NOT EXISTS rasters (settings BLOB, path TEXT, size INTEGER, "
                    "changed_ns INTEGER, image BLOB, PRIMARY KEY (settings, path)) WITHOUT ROWID"
                )
                yield database
        except sqlite3.Error as error:
            raise FileError(
                f"raster cache: {self.path} is damaged, not a file of rasters, or not writable; "
                "delete it, or choose another folder"
            ) from error


def load_rasters(
    cache: RasterCache, scans: ScanSet, raster: Raster, what: str, bar: Bar = progress_bar
) -> tuple[ScanSet, Rasters]:
    """The readable scans of a set and their rasters; logs those that are left out.

    Raises DataError if no scan is left, or too many cannot be used; see
    `deepring.data.left_out.LeftOut`. ``what`` names the set in messages.
    """
    with bar(what) as progress:
        readable, rasters, broken = cache.load(scans, raster, progress)
    if not len(readable):
        raise DataError(f"{what}: none of {len(scans)} scans can be read; first: {broken[0]}")
    left_out = LeftOut(what, len(scans))
    for reason in broken:
        left_out.add(reason)
    if broken:
        log.warning("%s", left_out)
    return readable, rasters


@dataclass(frozen=True)
class _Key:
    """Key of a row, and the size and modification time of its scan file."""

    settings: bytes
    path: str
    size: int
    changed_ns: int


def _keys(scans: ScanSet, raster: Raster) -> list[_Key]:
    settings = {
        "version": RASTER_VERSION,
        "reader": _decoding(scans.session),
        "raster": raster_settings(raster),
        "ground_z": scans.ground_z,
    }
    digests: dict[float | None, bytes] = {}
    keys = []
    for k, index in enumerate(scans.indices):
        path = scans.session.files[index].absolute()
        try:
            status = path.stat()
        except OSError:
            size, changed = -1, -1  # reading the file gives the error
        else:
            size, changed = status.st_size, status.st_mtime_ns
        turn = None if scans.turns is None else float(scans.turns[k])
        if turn not in digests:
            text = json.dumps({**settings, "turn": turn}, sort_keys=True)
            digests[turn] = hashlib.sha256(text.encode()).digest()
        keys.append(_Key(digests[turn], str(path), size, changed))
    return keys


def _decoding(session: Session) -> str:
    """Name of the way a session's files are read."""
    if session.decoding is not None:
        return session.decoding
    reader = session.read
    name = repr(reader) if is_dataclass(type(reader)) else reader.__qualname__
    return f"{reader.__module__}.{name}"


def _find(database: sqlite3.Connection, keys: list[_Key]) -> list[bytes | None]:
    """The rasters of the keys, `QUERY_ROWS` per query; None for missing or outdated ones."""
    images: list[bytes | None] = []
    for start in range(0, len(keys), QUERY_ROWS):
        part = keys[start : start + QUERY_ROWS]
        values = ", ".join(["(?, ?)"] * len(part))
        entries = {
            (settings, path): (size, changed, image)
            for settings, path, size, changed, image in database.execute(
                f"SELECT * FROM rasters WHERE (settings, path) IN (VALUES {values})",
                [value for key in part for value in (key.settings, key.path)],
            )
        }
        for key in part:
            size, changed, image = entries.get((key.settings, key.path), (None, None, None))
            fresh = (size, changed) == (key.size, key.changed_ns)
            images.append(image if fresh else None)
    return images


def _unless_blank(row: bytes | None, raster: Raster) -> bytes | None:
    """The row; None if nothing is to be seen in it, as earlier versions stored some."""
    if row is None:
        return None
    dtype = np.uint8 if raster.dtype == np.bool_ else raster.dtype
    return None if raster.is_blank(unpack(np.frombuffer(row, dtype), raster)) else row


def _store(database: sqlite3.Connection, rows: list[tuple[_Key, bytes | None]]) -> None:
    with database:
        database.executemany(
            "INSERT OR REPLACE INTO rasters VALUES (?, ?, ?, ?, ?)",
            [(key.settings, key.path, key.size, key.changed_ns, image) for key, image in rows],
        )


def _rasterize(scans: ScanSet, k: int, raster: Raster) -> bytes | BrokenScanError:
    try:
        return pack(scans.rasterize(k, raster), raster).tobytes()
    except BrokenScanError as error:
        return error
