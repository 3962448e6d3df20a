"""The raster cache: what it gives are the rasters of the scans, whatever its file holds."""

import sqlite3
from collections.abc import Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from deepring.data.cache import RasterCache
from deepring.data.readers import open_session
from deepring.data.scan_set import ScanSet
from deepring.rasters import BevRaster
from fuzz.files import Files, Format, read_back, written
from fuzz.formats.tables import _kitti
from fuzz.mutations.raw import raw

_FILE = "cache/rasters.sqlite"
_RASTER = BevRaster(cells=24)


def formats() -> Iterator[Format]:
    """The cache."""
    yield Format(
        "raster cache",
        _cached,
        (raw(_FILE), _other_values, _other_values, _other_schema),
        _rasters,
        _expected,
        weight=8,
        clean=True,
    )


def _rasters(folder: Path) -> Any:
    session = open_session("kitti", folder / "drive")
    scans = ScanSet(session, np.arange(len(session)), -1.8)
    readable, rasters, broken = RasterCache(folder / "cache").load(scans, _RASTER)
    return [len(readable), list(broken), rasters[:].numpy().tolist()]


_right: list[Any] = []


def _expected(_: Mapping[str, bytes]) -> Any:
    """The rasters without a cache."""
    return _right[0]


def _cached(folder: Path) -> Files:
    written(folder, {f"drive/{name}": content for name, content in _kitti().items()})
    value = _rasters(folder)
    _right[:] = [value]
    return read_back(folder)


def _other_values(rng: Random, files: Files) -> str:
    """A value of a row of another type, size or content, by SQL."""
    database = sqlite3.connect(":memory:")
    database.deserialize(files[_FILE])
    columns = [row[1] for row in database.execute("PRAGMA table_info(rasters)")]
    names = [name for name in columns if name not in ("settings", "path")]
    column = rng.choice(names)
    (old,) = rng.choice(list(database.execute(f"SELECT {column} FROM rasters")))
    values = [None, 0, -1, 2**62, 0.5, "text", "", b"", bytes(72), bytes(10**6), old]
    if isinstance(old, bytes) and old:
        at = rng.randrange(len(old))
        values += 3 * [old[:-1], old + b"\0", old[:at] + bytes([old[at] ^ 1]) + old[at + 1 :]]
    value = rng.choice(values)
    where = "1" if rng.random() < 0.3 else "path = (SELECT max(path) FROM rasters)"
    with database:
        database.execute(f"UPDATE rasters SET {column} = ? WHERE {where}", [value])
    files[_FILE] = database.serialize()
    database.close()
    return f"{column}: {str(value)[:30]}"


def _other_schema(rng: Random, files: Files) -> str:
    """A table of other columns, a view, a trigger, or none."""
    statements = (
        *("DROP TABLE rasters", "ALTER TABLE rasters RENAME TO other", "DELETE FROM rasters"),
        *(
            "ALTER TABLE rasters ADD COLUMN more TEXT",
            "ALTER TABLE rasters RENAME COLUMN image TO i",
        ),
        "CREATE TRIGGER t BEFORE INSERT ON rasters BEGIN SELECT RAISE(ABORT, 'no'); END",
        "PRAGMA user_version = 99",
        "CREATE TABLE more (x)",
    )
    statement = rng.choice(statements)
    database = sqlite3.connect(":memory:")
    database.deserialize(files[_FILE])
    if statement.startswith("CREATE TRIGGER") or rng.random() < 0.2:
        database.execute("DELETE FROM rasters")  # so that rows are inserted
    if rng.random() < 0.15:
        database.execute("DROP TABLE rasters")
        statement = rng.choice(
            (
                "CREATE VIEW rasters AS SELECT 1 AS settings, 2 AS path, 3 AS size, 4, 5",
                "CREATE TABLE rasters (a, b)",
                "CREATE TABLE rasters (settings, path, size, changed_ns, image)",
            )
        )
    database.execute(statement)
    database.commit()
    files[_FILE] = database.serialize()
    database.close()
    return statement
