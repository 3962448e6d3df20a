"""The raster cache: rasters on disk, keyed by everything that determines them.

Its SQLite file tolerates a kill during a write and several processes. The key of a row is the
raster's settings and the scan's path; a row is valid while size and modification time of the scan
file are unchanged, and those of the file of labels where the raster takes them. A BEV of 120 x 120
cells takes 1.8 kB. `deepring.data.raster_file` says what becomes of damaged rows and files.
"""

import hashlib
import json
import logging
from concurrent.futures import ThreadPoolExecutor
from dataclasses import is_dataclass
from pathlib import Path

import numpy as np

from deepring.data.left_out import LeftOut
from deepring.data.packed_rasters import Rasters, pack, packed_bytes, unpack
from deepring.data.raster_file import RasterFile, RasterKey
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DataError
from deepring.progress import Bar, Progress, progress_bar
from deepring.rasters import Raster, raster_settings

log = logging.getLogger(__name__)

#: Increase this when a code change alters the rasters of the same settings.
RASTER_VERSION = 1

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
        """The readable scans, their rasters, and the reason for each unreadable scan.

        Raises DataError for a session whose points lack columns of the raster.
        """
        scans.session.expect_columns(raster.columns)
        keys = _keys(scans, raster)
        broken: list[str] = []
        file = RasterFile(self.path)
        rows = [_unless_blank(row, raster) for row in file.find(keys, packed_bytes(raster))]
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
                file.store([(keys[k], row) for k in batch if (row := rows[k]) is not None])
                count += len(batch)
                if progress is not None:
                    progress(count, len(scans))
        readable = np.array([row is not None for row in rows], dtype=np.bool_)
        values = [row for row in rows if row is not None]
        dtype = np.uint8 if raster.dtype == np.bool_ else raster.dtype
        data = np.frombuffer(bytearray().join(values), dtype=dtype)
        data = data.reshape(len(values), -1 if values else 0)
        return scans.subset(readable), Rasters(data, raster), tuple(broken)


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


def _keys(scans: ScanSet, raster: Raster) -> list[RasterKey]:
    settings = {
        "version": RASTER_VERSION,
        "reader": _decoding(scans.session),
        "raster": raster_settings(raster),
        "ground_z": scans.ground_z,
    }
    if raster.columns:
        settings["columns"] = list(raster.columns)
    beside = [file for name in raster.columns if (file := scans.session.columns[name].file)]
    digests: dict[float | None, bytes] = {}
    keys = []
    for k, index in enumerate(scans.indices):
        path = scans.session.files[index].absolute()
        try:
            states = [file.stat() for file in (path, *(find(path) for find in beside))]
        except OSError:
            size, changed = -1, -1  # reading the file gives the error
        else:
            size = sum(state.st_size for state in states)
            changed = sum(state.st_mtime_ns for state in states)
        turn = None if scans.turns is None else float(scans.turns[k])
        if turn not in digests:
            text = json.dumps({**settings, "turn": turn}, sort_keys=True)
            digests[turn] = hashlib.sha256(text.encode()).digest()
        keys.append(RasterKey(digests[turn], str(path), size, changed))
    return keys


def _decoding(session: Session) -> str:
    """Name of the way a session's files are read."""
    if session.decoding is not None:
        return session.decoding
    reader = session.read
    name = repr(reader) if is_dataclass(type(reader)) else reader.__qualname__
    return f"{reader.__module__}.{name}"


def _unless_blank(row: bytes | None, raster: Raster) -> bytes | None:
    """The row; None if nothing is to be seen in it, as earlier versions stored some."""
    if row is None:
        return None
    dtype = np.uint8 if raster.dtype == np.bool_ else raster.dtype
    return None if raster.is_blank(unpack(np.frombuffer(row, dtype), raster)) else row


def _rasterize(scans: ScanSet, k: int, raster: Raster) -> bytes | BrokenScanError:
    try:
        return pack(scans.rasterize(k, raster), raster).tobytes()
    except BrokenScanError as error:
        return error
