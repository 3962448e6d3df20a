"""The cache: the images drawn directly, every change noticed, kills and neighbours survived."""

import contextlib
import multiprocessing
import os
import signal
import sqlite3
import threading
import time
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.data import cache as cache_module
from deepring.data import raster_file
from deepring.data.cache import RasterCache
from deepring.data.packed_rasters import Rasters, pack, unpack
from deepring.data.scan_set import ScanSet
from deepring.data.scans.columns import PointColumn
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DeepringError
from deepring.rasters import (
    RASTERS,
    BevRaster,
    ContextRaster,
    PolarRaster,
    Preprocessing,
    RangeRaster,
)
from deepring.testing import with_columns

SMALL = BevRaster(cells=24)
reads: list[Path] = []

#: Threads that parse headers at once may fail in CPython 3.11 (python/cpython#106905).
_PARSING = threading.Lock()


def read_npy(path):
    """Points of a file; it notes that it was asked."""
    reads.append(path)
    try:
        with _PARSING:
            return np.load(path)
    except (OSError, ValueError, EOFError) as error:
        raise BrokenScanError(f"{path}: {error}") from None


def read_mirrored(path):
    return read_npy(path) * np.float32([1, -1, 1])


@pytest.fixture(autouse=True)
def _no_reads_yet():
    reads.clear()


def session(folder, n=6, read=read_npy):
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for k in range(n):
        files.append(folder / f"{k}.npy")
        if not files[-1].exists():
            points = np.random.default_rng(k).uniform(-60, 60, (300, 3)).astype(np.float32)
            points[:, 2] = np.abs(points[:, 2]) / 4
            points[:200] = points[:200] / 12 + np.float32([20, 10, 1])  # dense: some count them
            np.save(files[-1], points)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = 5.0 * np.arange(n)
    columns = {"label": PointColumn(labels_of), "intensity": PointColumn(intensities_of)}
    xy = poses[:, :2, 3].copy()
    return Session("s", tuple(files), poses, xy, None, read, columns=columns)


def labels_of(path):
    return with_columns(np.load(path), ["label"])[:, 3]


def intensities_of(path):
    return with_columns(np.load(path), ["intensity"])[:, 3]


def scan_set(folder, n=6, **changes):
    return ScanSet(session(folder, n), np.arange(n), **changes)


def rows_of(path):
    with contextlib.closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT path, image FROM rasters").fetchall()
    return [(os.fsdecode(path), image) for path, image in rows]


@pytest.mark.parametrize("kind", RASTERS)
@pytest.mark.parametrize("turned", [False, True])
def test_images_are_those_drawn_directly_first_and_again(kind, turned, tmp_path):
    raster = RASTERS[kind]()
    turns = np.linspace(0, 3, 4) if turned else None
    scans = ScanSet(session(tmp_path / "s"), np.array([5, 0, 3, 1]), -0.5, turns)
    cache = RasterCache(tmp_path / "cache")
    direct = []
    for k, index in enumerate(scans.indices):
        points = np.load(scans.session.files[index])
        points = turn_points(points, turns[k]) if turned else points
        direct.append(raster(with_columns(points, raster.columns), -0.5))
    for _ in range(2):
        kept, images, broken = cache.load(scans, raster)
        assert broken == ()
        assert np.array_equal(kept.indices, scans.indices)
        assert np.array_equal(images[:].numpy(), np.stack(direct).astype(images[:].numpy().dtype))
    assert len(reads) == 4


def test_a_second_load_reads_no_scan(tmp_path):
    cache = RasterCache(tmp_path / "cache")
    cache.load(scan_set(tmp_path / "s"), SMALL)
    assert len(reads) == 6
    cache.load(scan_set(tmp_path / "s"), SMALL)
    RasterCache(tmp_path / "cache", workers=1).load(scan_set(tmp_path / "s"), SMALL)
    assert len(reads) == 6
    more = scan_set(tmp_path / "s", n=8)
    cache.load(more, SMALL)
    assert [path.name for path in sorted(reads[6:])] == ["6.npy", "7.npy"]


def test_a_bev_of_120_cells_takes_1800_bytes(tmp_path):
    cache = RasterCache(tmp_path / "cache")
    _, images, _ = cache.load(scan_set(tmp_path / "s", n=3), BevRaster())
    assert {len(image) for _, image in rows_of(cache.path)} == {1800}
    assert images.data.nbytes == 3 * 1800
    assert images[:].shape == (3, 120, 120)


@dataclass(frozen=True)
class Plain:
    """A raster of any shape and type."""

    shape: tuple[int, int]
    dtype: Any


@dataclass(frozen=True)
class Settled:
    """A reader with a setting."""

    lift: float

    def __call__(self, path):
        return read_npy(path) + np.float32([0, 0, self.lift])


def test_a_readers_settings_are_part_of_it(tmp_path):
    cache = RasterCache(tmp_path / "cache")
    for lift, drawn in ((0.0, 2), (0.0, 2), (3.0, 4)):
        scans = scan_set(tmp_path / "s", n=2)
        scans = replace(scans, session=session(tmp_path / "s", n=2, read=Settled(lift)))
        cache.load(scans, SMALL)
        assert len(reads) == drawn


def test_a_named_decoding_is_found_again_wherever_its_code_lies(tmp_path):
    """Moving or renaming a reader keeps the rasters; another decoding makes them anew."""
    cache, moved = RasterCache(tmp_path / "cache"), partial(read_npy)
    scans = [
        replace(session(tmp_path / "s", n=2, read=read), decoding=decoding)
        for read, decoding in ((read_npy, "npy"), (moved, "npy"), (read_npy, "npy 2"))
    ]
    for one, made in zip(scans, (2, 2, 4), strict=True):
        cache.load(ScanSet(one, np.arange(2)), SMALL)
        assert len(reads) == made


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.integers(1, 13), st.integers(1, 13), st.integers(0, 99))
def test_packing_round_trips_at_any_size(n, rows, columns, seed):
    values = np.random.default_rng(seed).random((n, rows, columns))
    for dtype, images in ((np.bool_, values > 0.5), (np.float16, values.astype(np.float16))):
        raster = Plain((rows, columns), np.dtype(dtype))
        packed = [pack(image, raster) for image in images]
        stored = np.stack(packed) if n else np.zeros((0, len(pack(values > 2, raster))), np.uint8)
        back = unpack(stored, raster)
        assert back.shape == (n, rows, columns)
        assert np.array_equal(back.astype(dtype), images)
        if dtype is np.bool_ and n:
            assert stored.shape[1] == -(-rows * columns // 8)


@pytest.mark.parametrize("raster", [SMALL, PolarRaster(7, 5), RangeRaster(6, 5), ContextRaster()])
def test_rows_of_any_index_are_unpacked(raster):
    n = 6
    images = np.random.default_rng(0).random((n, *raster.shape)) * 3 > 1
    images = images.astype(raster.dtype)
    rasters = Rasters(np.stack([pack(image, raster) for image in images]), raster)
    expected = torch.from_numpy(images.astype(np.uint8) if images.dtype == bool else images)
    assert len(rasters) == n
    assert torch.equal(rasters[2], expected[2])
    assert torch.equal(rasters[1:4], expected[1:4])
    pairs = np.array([[0, 5], [5, 3]])
    assert torch.equal(rasters[pairs], expected[torch.from_numpy(pairs)])


def changed_values(value):
    """Another value of the same kind for each field of a raster or of its preprocessing."""
    if isinstance(value, Preprocessing):
        changes = {f.name: changed_values(getattr(value, f.name)) for f in fields(value)}
        return [replace(value, **{name: v}) for name, vs in changes.items() for v in vs]
    if value is None:
        return [0.25]
    if isinstance(value, tuple) and len(value) > 2 and all(isinstance(n, int) for n in value):
        return [(*value[:-1], 2 * value[-1])]
    if isinstance(value, tuple) and len(value) != 2:
        return [(*value, 0.5)]
    if isinstance(value, tuple):
        return [(value[0] + 0.5, value[1]), (value[0], value[1] + 1)]
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, str):
        return [{"nearest": "last", "range": "difference", "sensor": "radial"}[value]]
    return [value + (3 if value == 1 else 2)]  # some are 1 or 4, and a window is odd


def changed_rasters():
    for kind, cls in RASTERS.items():
        # Cropped wider than it reaches, so that its reach may change alone.
        base = cls(preprocessing=Preprocessing(extent=160.0))
        if hasattr(base, "least"):  # with few points in a cell
            base = replace(base, least=1)
        if kind == "height_ranges":  # of whatever height the few points are
            base = replace(base, height=(-50.0, 50.0))
        if kind in ("ring_histogram", "range_normals"):
            base = replace(base, elevation=(-80.0, 80.0))
        for field in fields(base):
            for k, value in enumerate(changed_values(getattr(base, field.name))):
                yield pytest.param(
                    base, replace(base, **{field.name: value}), id=f"{kind}-{field.name}-{k}"
                )


@pytest.mark.parametrize(("raster", "changed"), list(changed_rasters()))
def test_every_changed_value_of_a_raster_is_noticed(raster, changed, tmp_path):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s", n=1)
    cache.load(scans, raster)
    _, images, _ = cache.load(scans, changed)
    assert len(reads) == 2
    points = with_columns(np.load(scans.session.files[0]), changed.columns)
    direct = changed(points, 0.0)
    assert np.array_equal(images[0].numpy(), direct.astype(images[0].numpy().dtype))
    cache.load(scans, raster)  # and the first is still there
    assert len(reads) == 2


@pytest.mark.parametrize(
    "change",
    [
        {"ground_z": 0.1},
        {"turns": np.zeros(2)},
        {"session": "another reader"},
    ],
    ids=["ground_z", "turns", "reader"],
)
def test_every_changed_way_to_see_a_scan_is_noticed(change, tmp_path):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s", n=2)
    cache.load(scans, SMALL)
    if "session" in change:
        change = {"session": session(tmp_path / "s", n=2, read=read_mirrored)}
    cache.load(replace(scans, **change), SMALL)
    assert len(reads) == 4


def test_each_yaw_is_noticed_by_itself(tmp_path):
    cache = RasterCache(tmp_path / "cache")
    cache.load(scan_set(tmp_path / "s", n=3, turns=np.array([0.0, 1.0, 2.0])), SMALL)
    cache.load(scan_set(tmp_path / "s", n=3, turns=np.array([0.0, 1.5, 2.0])), SMALL)
    assert sorted(path.name for path in reads) == ["0.npy", "1.npy", "1.npy", "2.npy"]


def test_another_version_of_the_code_is_noticed(tmp_path, monkeypatch):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s", n=1)
    cache.load(scans, SMALL)
    monkeypatch.setattr(cache_module, "RASTER_VERSION", cache_module.RASTER_VERSION + 1)
    cache.load(scans, SMALL)
    assert len(reads) == 2


def test_a_file_of_another_size_is_noticed(tmp_path):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s", n=2)
    file = scans.session.files[1]
    stat = file.stat()
    cache.load(scans, SMALL)
    np.save(file, np.float32([[10, 10, 0], [10, 10, 5]]))
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # the same time: the size alone
    _, images, _ = cache.load(scans, SMALL)
    assert [path.name for path in reads[2:]] == ["1.npy"]
    assert np.array_equal(images[1].numpy(), SMALL(np.load(file), 0.0))


def test_a_file_of_another_time_is_noticed(tmp_path):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s", n=2)
    file = scans.session.files[0]
    stat = file.stat()
    cache.load(scans, SMALL)
    np.save(file, np.load(file)[::-1] * np.float32(0.5))
    assert file.stat().st_size == stat.st_size
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1000))
    _, images, _ = cache.load(scans, SMALL)
    assert [path.name for path in reads[2:]] == ["0.npy"]
    assert np.array_equal(images[0].numpy(), SMALL(np.load(file), 0.0))
    assert len(rows_of(cache.path)) == 2  # the outdated row has gone


def test_broken_scans_are_left_out_reported_and_not_cached(tmp_path):
    scans = scan_set(tmp_path / "s", turns=np.arange(6.0))
    scans.session.files[1].write_bytes(b"junk")
    scans.session.files[4].unlink()
    cache = RasterCache(tmp_path / "cache")
    for attempt in range(2):
        kept, images, broken = cache.load(scans, SMALL)
        assert kept.indices.tolist() == [0, 2, 3, 5]
        assert kept.turns.tolist() == [0, 2, 3, 5]
        assert len(images) == 4
        assert [Path(reason.split(":")[0]).name for reason in broken] == ["1.npy", "4.npy"]
        assert len(reads) == 6 + 2 * attempt  # tried again, since it may have been mended
    assert len(rows_of(cache.path)) == 4
    session(tmp_path / "s")  # writes the missing file anew
    scans.session.files[1].write_bytes(scans.session.files[0].read_bytes())
    kept, images, broken = cache.load(scans, SMALL)
    assert broken == ()
    direct = SMALL(turn_points(np.load(scans.session.files[1]), 1.0), 0.0)
    assert np.array_equal(images[1].numpy(), direct)


def test_a_set_of_broken_scans_alone_is_reported_too(tmp_path):
    scans = scan_set(tmp_path / "s", n=2)
    for file in scans.session.files:
        file.write_bytes(b"")
    kept, images, broken = RasterCache(tmp_path / "cache").load(scans, SMALL)
    assert (len(kept), len(images), len(broken)) == (0, 0, 2)
    assert images[:].shape == (0, 24, 24)


def test_no_scans_are_no_images(tmp_path):
    kept, images, broken = RasterCache(tmp_path / "c").load(scan_set(tmp_path / "s", n=0), SMALL)
    assert (len(kept), len(images), broken) == (0, 0, ())


def test_progress_begins_with_what_is_there_and_ends_with_all(tmp_path, monkeypatch):
    monkeypatch.setattr(cache_module, "BATCH", 2)
    cache, seen = RasterCache(tmp_path / "cache"), []
    cache.load(scan_set(tmp_path / "s", n=1), SMALL)
    cache.load(scan_set(tmp_path / "s"), SMALL, lambda *counts: seen.append(counts))
    assert seen == [(1, 6), (3, 6), (5, 6), (6, 6)]


@pytest.mark.parametrize("raster", [BevRaster(cells=16), RangeRaster(8, 4)])
def test_images_of_every_batch_keep_their_order(raster, tmp_path, monkeypatch):
    monkeypatch.setattr(cache_module, "BATCH", 4)
    scans = scan_set(tmp_path / "s", n=11)
    _, images, _ = RasterCache(tmp_path / "cache", workers=3).load(scans, raster)
    direct = [raster(np.load(file), 0.0) for file in scans.session.files]
    assert np.array_equal(images[:].numpy().astype(raster.dtype), np.stack(direct))


def load_slowly(folder, cache_folder, barrier, n):
    """What a process of its own does: a transaction a scan, beside another process."""
    cache_module.BATCH = 1
    scans = scan_set(folder, n=n)
    barrier.wait(30)
    _, images, broken = RasterCache(cache_folder).load(scans, SMALL)
    direct = np.stack([SMALL(np.load(file), 0.0) for file in scans.session.files])
    assert not broken
    assert np.array_equal(images[:].numpy(), direct)


def test_two_processes_at_once_end_with_the_right_rows(tmp_path):
    n = 40
    scans = scan_set(tmp_path / "s", n=n)
    spawn = multiprocessing.get_context("spawn")
    barrier = spawn.Barrier(2)
    both = [
        spawn.Process(target=load_slowly, args=(tmp_path / "s", tmp_path / "cache", barrier, n))
        for _ in range(2)
    ]
    for process in both:
        process.start()
    for process in both:
        process.join(60)
    assert [process.exitcode for process in both] == [0, 0]
    rows = dict(rows_of(tmp_path / "cache" / "rasters.sqlite"))
    assert len(rows) == n
    for file in scans.session.files:
        assert rows[str(file)] == pack(SMALL(np.load(file), 0.0), SMALL).tobytes()


def write_for_ever(path, ready):
    """Hold a transaction that has spilled to the disk, until killed."""
    database = sqlite3.connect(path)
    database.execute("PRAGMA cache_size = 2")
    rows = ((b"k", b"%d" % k, 1, 1, bytes(5000), 0) for k in range(500))
    database.executemany("INSERT OR REPLACE INTO rasters VALUES (?, ?, ?, ?, ?, ?)", rows)
    ready.set()
    time.sleep(60)


def test_a_kill_in_mid_write_leaves_a_cache_that_works(tmp_path):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s")
    cache.load(scans, SMALL)
    before = rows_of(cache.path)
    spawn = multiprocessing.get_context("spawn")
    ready = spawn.Event()
    writer = spawn.Process(target=write_for_ever, args=(cache.path, ready))
    writer.start()
    assert ready.wait(30)
    journal = cache.path.with_name(cache.path.name + "-journal")
    assert journal.stat().st_size > 0  # the file itself holds half a transaction now
    os.kill(writer.pid, signal.SIGKILL)
    writer.join(30)
    assert writer.exitcode == -signal.SIGKILL

    reads.clear()
    _, images, broken = cache.load(scan_set(tmp_path / "s", n=8), SMALL)
    assert broken == ()
    assert len(images) == 8
    assert len(reads) == 2  # what was there before is still there
    assert set(before) < set(rows_of(cache.path))
    assert len(rows_of(cache.path)) == 8  # and nothing of the killed transaction


def load_one_by_one(folder, cache_folder, n):
    cache_module.BATCH = 1

    def slowly(done, total):
        time.sleep(0.02)

    RasterCache(cache_folder).load(scan_set(folder, n=n), SMALL, slowly)


def test_a_killed_load_keeps_what_it_had_drawn(tmp_path):
    n = 200
    scans = scan_set(tmp_path / "s", n=n)
    path = tmp_path / "cache" / "rasters.sqlite"
    spawn = multiprocessing.get_context("spawn")
    loader = spawn.Process(target=load_one_by_one, args=(tmp_path / "s", path.parent, n))
    loader.start()
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        with contextlib.suppress(sqlite3.OperationalError):
            if path.exists() and len(rows_of(path)) >= 5:
                break
        time.sleep(0.01)
    os.kill(loader.pid, signal.SIGKILL)
    loader.join(30)
    kept = len(rows_of(path))
    assert 5 <= kept < n
    reads.clear()
    _, images, _ = RasterCache(path.parent).load(scans, SMALL)
    assert len(reads) == n - kept
    direct = np.stack([SMALL(np.load(file), 0.0) for file in scans.session.files])
    assert np.array_equal(images[:].numpy(), direct)


def overwrite_all(path):
    path.write_bytes(b"this is no database, but a text of some length" * 100)


def overwrite_pages(path):
    data = bytearray(path.read_bytes())
    data[4096:] = os.urandom(len(data) - 4096)
    path.write_bytes(data)


def other_columns(path):
    path.unlink()
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE rasters (settings BLOB, image BLOB)")


def cut_short(path):
    path.write_bytes(path.read_bytes()[:9000])


def of_before(path):
    """The table of the version without checksums."""
    path.unlink()
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute(
            "CREATE TABLE rasters (settings BLOB, path TEXT, size INTEGER, changed_ns INTEGER, "
            "image BLOB, PRIMARY KEY (settings, path)) WITHOUT ROWID"
        )


def a_trigger(path):
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TRIGGER t AFTER INSERT ON rasters BEGIN DELETE FROM rasters; END")


def a_name_that_is_no_text(path):
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE others (x)")
    content = path.read_bytes()
    assert b"tableothersothers" in content
    path.write_bytes(content.replace(b"tableothersothers", b"tableother\xccothers"))


@pytest.mark.parametrize(
    "damage",
    [
        *(overwrite_all, overwrite_pages, other_columns, cut_short, of_before, a_trigger),
        a_name_that_is_no_text,
    ],
)
def test_a_file_that_is_no_whole_cache_is_set_aside_and_made_anew_said_once(
    damage, tmp_path, caplog
):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s", n=40)
    first = cache.load(scans, SMALL)[1].data
    damage(cache.path)
    content = cache.path.read_bytes()
    assert np.array_equal(cache.load(scans, SMALL)[1].data, first)
    aside = cache.path.with_name("rasters.sqlite.corrupt")
    assert aside.read_bytes() == content
    (said,) = caplog.messages
    assert str(cache.path) in said
    assert aside.name in said
    reads.clear()
    assert np.array_equal(cache.load(scans, SMALL)[1].data, first)
    assert (len(reads), len(caplog.messages)) == (0, 1)


@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_a_flipped_bit_anywhere_changes_no_raster(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp() / "flips"
    cache, scans = RasterCache(folder / "cache"), scan_set(folder / "s", n=40)
    first = cache.load(scans, SMALL)[1].data
    content = bytearray(cache.path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    cache.path.write_bytes(content)
    assert np.array_equal(cache.load(scans, SMALL)[1].data, first)


def test_a_file_that_only_its_header_forbids_to_write_is_made_anew(tmp_path, caplog):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s")
    cache.load(scans, SMALL)
    content = bytearray(cache.path.read_bytes())
    content[18] = 3  # the version that writes; SQLite knows 1 and 2
    cache.path.write_bytes(content)
    changed = scan_set(tmp_path / "s", n=8)  # rows have to be stored again
    expected = RasterCache(tmp_path / "other").load(changed, SMALL)[1].data
    assert np.array_equal(cache.load(changed, SMALL)[1].data, expected)
    assert any("is damaged" in message for message in caplog.messages)


@pytest.mark.parametrize("column", ["size", "changed_ns", "image", "checksum"])
@pytest.mark.parametrize("value", [None, -1, 2**62, 0.5, "text", b"", bytes(72), bytes(10**5)])
def test_rows_that_are_not_as_they_were_stored_are_made_again(column, value, tmp_path, caplog):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s")
    first = cache.load(scans, SMALL)[1].data
    with contextlib.closing(sqlite3.connect(cache.path)) as database, database:
        database.execute(f"UPDATE rasters SET {column} = ?", [value])
    assert np.array_equal(cache.load(scans, SMALL)[1].data, first)
    assert len(reads) == 12
    (said,) = caplog.messages
    assert "6 damaged rasters" in said


def test_a_file_that_another_process_has_made_anew_is_not_set_aside(tmp_path, caplog):
    cache, scans = RasterCache(tmp_path / "cache"), scan_set(tmp_path / "s")
    cache.load(scans, SMALL)
    file = raster_file.RasterFile(cache.path)

    def damaged_until_another_made_it_anew(database):
        if not cache.path.with_name("mine").exists():
            cache.path.rename(cache.path.with_name("mine"))
            RasterCache(cache.path.parent).load(scans, SMALL)
            raise sqlite3.DatabaseError("file is not a database")
        return database.execute("SELECT count(*) FROM rasters").fetchone()

    assert file._attempt(damaged_until_another_made_it_anew) == (6,)
    assert not caplog.messages


def test_names_that_are_no_text_are_kept(tmp_path):
    file = tmp_path / os.fsdecode(b"\xff.npy")
    np.save(file, np.load(session(tmp_path / "s").files[0]))
    scans = ScanSet(replace(session(tmp_path / "s", n=1), files=(file,)), np.arange(1))
    cache = RasterCache(tmp_path / "cache")
    reads.clear()
    for _ in range(2):
        cache.load(scans, SMALL)
    assert reads == [file]


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DeepringError, match="raster cache"):
        RasterCache(tmp_path / "file").load(scan_set(tmp_path / "s", n=1), SMALL)
    with pytest.raises(DeepringError, match="raster cache"):
        RasterCache(tmp_path / "file" / "cache").load(scan_set(tmp_path / "s", n=1), SMALL)


def test_errors_that_are_not_the_scans_fault_are_not_swallowed(tmp_path):
    def fail(path):
        raise RuntimeError("a bug")

    scans = ScanSet(session(tmp_path / "s", n=2, read=fail), np.arange(2))
    with pytest.raises(RuntimeError, match="a bug"):
        RasterCache(tmp_path / "cache").load(scans, SMALL)
