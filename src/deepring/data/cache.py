"""Rasters on disk, keyed by everything that made them.

One SQLite file holds all: its transactions make a kill in mid-write and a second process
harmless. A row is found by the raster's settings and the scan's path, and counts only while the
scan file has the size and time of change it had then. A BEV of 120 x 120 cells takes 1.8 kB.
"""

import hashlib
import json
import logging
import sqlite3
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.core.rigid import turn_points, yaw_of
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DeepringError
from deepring.progress import progress_bar
from deepring.rasters import Raster, raster_settings

log = logging.getLogger(__name__)

#: Raise when a change in the code changes the images that the same settings make.
RASTER_VERSION = 1

Progress = Callable[[int, int], None]
"""Called with the number of scans done and their total."""

Bar = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of a title."""

#: Rows asked for at once; SQLite takes no more than some thousand values a query.
LOOKED_UP = 400

#: Scans a transaction: what a kill can lose, and how long a second process waits.
BATCH = 64


@dataclass(frozen=True, eq=False)
class ScanSet:
    """Some scans of a session, in order, as a method is to see them.

    ``ground_z`` is the z of the ground under the sensor in the scan's frame (metres); ``turns``
    (n,) radians turn each scan before it is drawn, None leaves them as they are.
    """

    session: Session
    indices: NDArray[np.int64]
    ground_z: float = 0.0
    turns: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def positions(self) -> NDArray[np.float64]:
        """World positions (n, 2), metres."""
        return self.session.positions[self.indices]

    @property
    def ground_truth(self) -> NDArray[np.float64]:
        """Ground-truth positions (n, 2), as the dataset writes them."""
        return self.session.ground_truth[self.indices]

    @property
    def headings(self) -> NDArray[np.float64]:
        """Yaw of the scan frames in the world (n,), radians, counter-clockwise, before any turn."""
        return yaw_of(self.session.poses[self.indices])

    def subset(self, keep: NDArray[np.bool_]) -> "ScanSet":
        """The scans where ``keep`` (n,) holds."""
        turns = None if self.turns is None else self.turns[keep]
        return ScanSet(self.session, self.indices[keep], self.ground_z, turns)

    def draw(self, k: int, raster: Raster) -> NDArray[Any]:
        """Read scan ``k`` of the set and draw it. Raises BrokenScanError."""
        points = self.session.points(int(self.indices[k]))
        if self.turns is not None:
            points = turn_points(points, float(self.turns[k]))
        return raster(points, self.ground_z)


@dataclass(frozen=True, eq=False)
class Rasters:
    """Images of n scans in memory; bool images stay bit-packed until they are asked for."""

    data: NDArray[Any]
    raster: Raster

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, rows: Any) -> torch.Tensor:
        """Images (k, *raster.shape) of ``rows``: bool as uint8 0 or 1, others as stored."""
        return torch.from_numpy(unpack(self.data[rows], self.raster))


def pack(image: NDArray[Any], raster: Raster) -> NDArray[Any]:
    """Flat uint8 or raw values of one image, as stored."""
    return np.packbits(image) if raster.dtype == np.bool_ else image.ravel()


def unpack(data: NDArray[Any], raster: Raster) -> NDArray[Any]:
    """Images (k, *shape) of stored rows (k, m)."""
    if raster.dtype == np.bool_:
        data = np.unpackbits(data, axis=-1, count=int(np.prod(raster.shape)))
    return np.ascontiguousarray(data).reshape(*data.shape[:-1], *raster.shape)


class RasterCache:
    """Draws scans, or finds them drawn.

    Args:
        folder: where ``rasters.sqlite`` lies or will lie; made if missing. It must be on a
            local disk where several processes share it, as SQLite demands.
        workers: threads that draw; the compiled loops leave the interpreter free.
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
                    images = pool.map(lambda k: _draw(scans, k, raster), batch)
                    for k, image in zip(batch, images, strict=True):
                        if isinstance(image, BrokenScanError):
                            broken.append(str(image))
                        else:
                            rows[k] = image
                    _store(database, [(keys[k], rows[k]) for k in batch if rows[k] is not None])
                    done += len(batch)
                    if progress is not None:
                        progress(done, len(scans))
        keep = np.array([row is not None for row in rows], dtype=np.bool_)
        values = [row for row in rows if row is not None]
        stored = np.uint8 if raster.dtype == np.bool_ else raster.dtype
        data = np.frombuffer(bytearray().join(values), dtype=stored)
        data = data.reshape(len(values), -1 if values else 0)
        return scans.subset(keep), Rasters(data, raster), tuple(broken)

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DeepringError(
                f"paths.cache: {self.path.parent} cannot be made ({error.strerror}); choose "
                "another folder with paths.cache=FOLDER"
            ) from error
        try:
            with closing(sqlite3.connect(self.path, timeout=60.0)) as database:
                database.execute(
                    "CREATE TABLE IF NOT EXISTS rasters (settings BLOB, path TEXT, size INTEGER, "
                    "changed_ns INTEGER, image BLOB, PRIMARY KEY (settings, path)) WITHOUT ROWID"
                )
                yield database
        except sqlite3.Error as error:
            raise DeepringError(
                f"paths.cache: {self.path} cannot be used ({error}); delete the file, or choose "
                "another folder with paths.cache=FOLDER"
            ) from error


def load_rasters(
    cache: RasterCache, scans: ScanSet, raster: Raster, what: str, bar: Bar = progress_bar
) -> tuple[ScanSet, Rasters]:
    """Rasters of a scan set; broken scans are left out and reported. All broken is an error."""
    with bar(what) as progress:
        kept, rasters, broken = cache.load(scans, raster, progress)
    if not len(kept):
        raise DeepringError(f"{what}: none of {len(scans)} scans can be read; first: {broken[0]}")
    if broken:
        log.warning("%s: left out %d broken scans; first: %s", what, len(broken), broken[0])
    return kept, rasters


@dataclass(frozen=True)
class _Key:
    """What a stored row is found by, and what must not have changed since."""

    settings: bytes
    path: str
    size: int
    changed_ns: int


def _keys(scans: ScanSet, raster: Raster) -> list[_Key]:
    everything = {
        "version": RASTER_VERSION,
        "reader": _reader(scans.session.read),
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
            size, changed = -1, -1  # drawing it will say what is wrong
        else:
            size, changed = status.st_size, status.st_mtime_ns
        turn = None if scans.turns is None else float(scans.turns[k])
        if turn not in digests:
            settings = json.dumps({**everything, "turn": turn}, sort_keys=True).encode()
            digests[turn] = hashlib.sha256(settings).digest()
        keys.append(_Key(digests[turn], str(path), size, changed))
    return keys


def _reader(read: Callable[[Path], Any]) -> str:
    """What tells a reader from another: its name, or its type and settings where it has some."""
    if is_dataclass(read):
        return f"{type(read).__module__}.{read!r}"
    return f"{read.__module__}.{read.__qualname__}"


def _find(database: sqlite3.Connection, keys: list[_Key]) -> list[bytes | None]:
    """The rows of the keys, `LOOKED_UP` a query; None for those that are not there."""
    found: list[bytes | None] = []
    for start in range(0, len(keys), LOOKED_UP):
        some = keys[start : start + LOOKED_UP]
        values = ", ".join(["(?, ?)"] * len(some))
        held = {
            (settings, path): (size, changed, image)
            for settings, path, size, changed, image in database.execute(
                f"SELECT * FROM rasters WHERE (settings, path) IN (VALUES {values})",
                [value for key in some for value in (key.settings, key.path)],
            )
        }
        for key in some:
            size, changed, image = held.get((key.settings, key.path), (None, None, None))
            fresh = (size, changed) == (key.size, key.changed_ns)
            found.append(image if fresh else None)
    return found


def _store(database: sqlite3.Connection, rows: list[tuple[_Key, bytes | None]]) -> None:
    with database:
        database.executemany(
            "INSERT OR REPLACE INTO rasters VALUES (?, ?, ?, ?, ?)",
            [(key.settings, key.path, key.size, key.changed_ns, image) for key, image in rows],
        )


def _draw(scans: ScanSet, k: int, raster: Raster) -> bytes | BrokenScanError:
    try:
        return pack(scans.draw(k, raster), raster).tobytes()
    except BrokenScanError as error:
        return error
