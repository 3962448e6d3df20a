"""The raster cache: rasters on disk, keyed by everything that made them.

One SQLite file holds all: its transactions make a kill in mid-write and a second process
harmless. A row is found by the raster's settings and the scan's path, and counts only while the
scan file has the size and time of change it had then. A BEV of 120 x 120 cells takes 1.8 kB.
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

from deepring.data.packed_rasters import Rasters, pack
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DataError, FileError
from deepring.progress import Bar, Progress, progress_bar
from deepring.rasters import Raster, raster_settings

log = logging.getLogger(__name__)

#: Raise when a change in the code changes the images that the same settings make.
RASTER_VERSION = 1

#: Rows asked for at once; SQLite takes no more than some thousand values a query.
LOOKED_UP = 400

#: Scans a transaction: what a kill can lose, and how long a second process waits.
BATCH = 64


class RasterCache:
    """Makes rasters of scans, or finds those made before.

    Args:
        folder: where ``rasters.sqlite`` lies or will lie; made if missing. It must be on a
            local disk where several processes share it, as SQLite demands.
        workers: threads that rasterize; the compiled loops leave the interpreter free.
    """

    def __init__(self, folder: Path, workers: int = 2) -> None:
        self.path = Path(folder) / "rasters.sqlite"
        self.workers = max(1, workers)

    def load(
        self, scans: ScanSet, raster: Raster, progress: Progress | None = None
    ) -> tuple[ScanSet, Rasters, tuple[str, ...]]:
        """Rasters of the scans that can be read, those scans, and the reasons of the others."""
        keys = _keys(scans, raster)
        broken: list[str] = []
        with self._database() as database:
            rows = _find(database, keys)
            missing = [k for k, row in enumerate(rows) if row is None]
            done = len(scans) - len(missing)
            if progress is not None:
                progress(done, len(scans))
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
                    done += len(batch)
                    if progress is not None:
                        progress(done, len(scans))
        readable = np.array([row is not None for row in rows], dtype=np.bool_)
        values = [row for row in rows if row is not None]
        stored = np.uint8 if raster.dtype == np.bool_ else raster.dtype
        data = np.frombuffer(bytearray().join(values), dtype=stored)
        data = data.reshape(len(values), -1 if values else 0)
        return scans.subset(readable), Rasters(data, raster), tuple(broken)

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(
                f"raster cache: folder {self.path.parent} cannot be made ({error.strerror}); "
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
                f"raster cache: {self.path} is damaged, or no file of rasters, or cannot be "
                "written; delete it, or choose another folder"
            ) from error


def load_rasters(
    cache: RasterCache, scans: ScanSet, raster: Raster, what: str, bar: Bar = progress_bar
) -> tuple[ScanSet, Rasters]:
    """Rasters of a scan set; broken scans are left out and reported. All broken is an error."""
    with bar(what) as progress:
        readable, rasters, broken = cache.load(scans, raster, progress)
    if not len(readable):
        raise DataError(f"{what}: none of {len(scans)} scans can be read; first: {broken[0]}")
    if broken:
        log.warning("%s: left out %d broken scans; first: %s", what, len(broken), broken[0])
    return readable, rasters


@dataclass(frozen=True)
class _Key:
    """Key of a stored row, and the size and time of the scan file it was made of."""

    settings: bytes
    path: str
    size: int
    changed_ns: int


def _keys(scans: ScanSet, raster: Raster) -> list[_Key]:
    everything = {
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
            size, changed = -1, -1  # reading it will say what is wrong
        else:
            size, changed = status.st_size, status.st_mtime_ns
        turn = None if scans.turns is None else float(scans.turns[k])
        if turn not in digests:
            settings = json.dumps({**everything, "turn": turn}, sort_keys=True).encode()
            digests[turn] = hashlib.sha256(settings).digest()
        keys.append(_Key(digests[turn], str(path), size, changed))
    return keys


def _decoding(session: Session) -> str:
    """Name of how a session's files are read."""
    read = session.read
    if session.decoding is not None:
        return session.decoding
    name = repr(read) if is_dataclass(type(read)) else read.__qualname__
    return f"{read.__module__}.{name}"


def _find(database: sqlite3.Connection, keys: list[_Key]) -> list[bytes | None]:
    """The rows of the keys, `LOOKED_UP` a query; None for those that are not there."""
    images: list[bytes | None] = []
    for start in range(0, len(keys), LOOKED_UP):
        some = keys[start : start + LOOKED_UP]
        values = ", ".join(["(?, ?)"] * len(some))
        stored = {
            (settings, path): (size, changed, image)
            for settings, path, size, changed, image in database.execute(
                f"SELECT * FROM rasters WHERE (settings, path) IN (VALUES {values})",
                [value for key in some for value in (key.settings, key.path)],
            )
        }
        for key in some:
            size, changed, image = stored.get((key.settings, key.path), (None, None, None))
            fresh = (size, changed) == (key.size, key.changed_ns)
            images.append(image if fresh else None)
    return images


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
