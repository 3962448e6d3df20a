"""Bags that are damaged, not closed or contradict themselves: all scans, or how many were read."""

import re
import shutil
import sqlite3
import struct
import sys

import numpy as np
import pytest
import yaml
from backports import zstd
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader

from deepring.data.scans.bag_files import bag_scans
from deepring.errors import BrokenScanError, DataError, DeepringError, FileError
from helpers import mcap
from helpers.bags import KINDS, START, describe, encoded, message, write_bag

SCANS = np.random.default_rng(0).normal(0, 20, (6, 5, 3)).astype(np.float32)
CLOUDS = [message(scan) for scan in SCANS]
MESSAGES = [mcap.message(START + k, encoded(cloud, START + k)) for k, cloud in enumerate(CLOUDS)]

every_kind = pytest.mark.parametrize("kind", KINDS)


def read(path, **options):
    """The scans before an error, and the error's words or None."""
    scans = []
    try:
        scans.extend(scan.read() for scan in bag_scans(path, **options))
    except DeepringError as error:
        return scans, str(error)
    return scans, None


def all_or_an_error(path, scans=SCANS):
    """Whether all scans are read; if not, the error must say so."""
    found, error = read(path)
    rest = iter(scans)  # what is found is a part of it, in its order
    assert all(any(np.array_equal(scan, other) for other in rest) for scan in found)
    assert error or len(found) == len(scans)
    assert not error or re.search(r"^bag .*drive[^\n]*$", error)
    return error is None


def file_of(path):
    return next(path.glob("*.db3")) if path.is_dir() else path


def chunks(compression="zstd", crc=True):
    """Six messages in chunks of two; schema and channel in the first."""
    both = [mcap.schema(), mcap.channel()]
    parts = [both + MESSAGES[:2], MESSAGES[2:4], MESSAGES[4:]]
    return [
        mcap.chunk(part, (START + 2 * k, START + 2 * k + 1), compression, crc)
        for k, part in enumerate(parts)
    ]


SUMMARY = mcap.schema() + mcap.channel() + mcap.statistics({1: 6}, 3)
FORMS = [
    mcap.mcap(b"".join(chunks("lz4")), SUMMARY),
    mcap.mcap(b"".join(chunks("zstd")), SUMMARY),
    mcap.mcap(b"".join(chunks("")), SUMMARY, crc=False),
    mcap.mcap(b"".join(chunks("zstd"))),
    mcap.mcap(mcap.schema() + mcap.channel() + b"".join(MESSAGES)),
    mcap.mcap(mcap.schema() + mcap.channel() + b"".join(MESSAGES), SUMMARY),
]


@pytest.mark.parametrize("data", FORMS)
def test_mcap_files_of_every_form_are_read_as_another_library_does(data, tmp_path):
    path = tmp_path / "drive.mcap"
    path.write_bytes(data)
    assert all_or_an_error(path)
    describe(path, START, len(CLOUDS))
    with Reader(tmp_path) as bag:
        theirs = [(time, bytes(raw)) for _, time, raw in bag.messages()]
    assert theirs == [(START + k, encoded(c, START + k)) for k, c in enumerate(CLOUDS)]


@pytest.mark.parametrize("data", FORMS)
def test_mcap_files_cut_anywhere(data, tmp_path):
    path = tmp_path / "drive.mcap"
    for size in range(0, len(data), 19):
        path.write_bytes(data[:size])
        assert not all_or_an_error(path)


@pytest.mark.parametrize("data", [FORMS[0], FORMS[1], FORMS[3]])
def test_altered_bytes_are_noticed_by_checksums(data, tmp_path):
    path = tmp_path / "drive.mcap"
    for at in range(0, len(data), 13):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x41]) + data[at + 1 :])
        all_or_an_error(path)


def test_mcap_says_how_many_were_read(tmp_path):
    path = tmp_path / "drive.mcap"
    first, second, third = chunks()
    broken = bytearray(second)
    broken[-9] ^= 1
    path.write_bytes(mcap.mcap(first + broken + third, SUMMARY))
    found, error = read(path)
    assert np.array_equal(found, SCANS[:2])
    assert re.search(r"drive\.mcap: 2 of 6 messages on /points read: chunk at byte \d+: ", error)
    assert "`mcap recover`" in error
    path.write_bytes(mcap.mcap(first + third, SUMMARY))  # a chunk is missing
    found, error = read(path)
    assert len(found) == 4
    assert "4 messages on /points read, but its index says 6" in error
    path.write_bytes(mcap.mcap(first + second + third)[:-48])  # not closed
    found, error = read(path, every=2)
    assert np.array_equal(found, SCANS[::2])
    assert "6 messages on /points read; how many more there were is unknown: " in error


def test_a_chunk_may_not_grow_beyond_its_size(tmp_path):
    path = tmp_path / "drive.mcap"
    bomb = zstd.compress(bytes(10**7))
    for size in (100, 2**40):
        head = struct.pack("<QQQI", 0, 9, size, 0) + mcap.text("zstd")
        path.write_bytes(mcap.mcap(mcap.record(6, head + struct.pack("<Q", len(bomb)) + bomb)))
        assert re.search(r"when decompressed", read(path)[1])


def test_what_mcap_files_hold_besides_ros_is_named(tmp_path):
    path = tmp_path / "drive.mcap"
    foreign = mcap.schema(name="foxglove.PointCloud", encoding="protobuf")
    path.write_bytes(mcap.mcap(foreign + mcap.channel(encoding="protobuf") + MESSAGES[0]))
    with pytest.raises(DataError, match=r"no point clouds.*\(foxglove\.PointCloud, 1 message\)"):
        next(bag_scans(path))
    path.write_bytes(mcap.mcap(mcap.schema() + mcap.channel(encoding="json") + MESSAGES[0]))
    with pytest.raises(DataError, match="encoded as json; expected cdr or ros1"):
        next(bag_scans(path))
    head = struct.pack("<QQQI", 0, 9, 3, 0) + mcap.text("brotli")
    path.write_bytes(mcap.mcap(mcap.record(6, head + struct.pack("<Q", 3) + b"abc")))
    with pytest.raises(DataError, match="compressed with 'brotli'; expected bz2, lz4, zstd"):
        next(bag_scans(path))


@pytest.mark.parametrize("kind", ["bag", "db3", "folder"])
def test_other_bags_cut_anywhere(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/points": CLOUDS})
    file = file_of(path)
    data = file.read_bytes()
    for size in range(0, len(data), len(data) // 25):
        file.write_bytes(data[:size])
        assert not all_or_an_error(path)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_recording_that_was_not_closed_is_read_up_to_its_end(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/points": CLOUDS})
    data = path.read_bytes()
    if kind == "bag":  # the header says 0 until the bag is closed
        at = data.index(b"index_pos=") + len(b"index_pos=")
        end = int.from_bytes(data[at : at + 8], "little")
        path.write_bytes(data[:at] + bytes(8) + data[at + 8 : end])
    else:
        path.write_bytes(data[: data.index(b"serialized_metadata") - 25])
    found, error = read(path)
    assert np.array_equal(found, SCANS)
    assert re.search("6 messages on /points read; how many more .* (not closed|no end|ends)", error)


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_chunks_of_ros_1(compression, tmp_path):
    path = write_bag(tmp_path, "bag", {"/points": CLOUDS}, compression=compression)
    assert all_or_an_error(path)
    data = bytearray(path.read_bytes())
    at = data.index({"bz2": b"BZh", "lz4": b"\x04\x22\x4d\x18"}[compression])
    data[at + 5] ^= 0xFF  # lz4 as rosbags writes it has no checksum but that of its header
    path.write_bytes(data)
    assert not all_or_an_error(path)


def test_an_index_of_ros_1_is_held_against_the_messages(tmp_path):
    path = write_bag(tmp_path, "bag", {"/points": CLOUDS})
    data = path.read_bytes()
    count = struct.pack("<II", 0, 6)  # of connection 0, in the chunk's information
    assert data.endswith(count)
    path.write_bytes(data[:-8] + struct.pack("<II", 0, 9))
    found, error = read(path)
    assert len(found) == 6
    assert "6 messages on /points read, but its index says 9" in error


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"#ROSBAG V2.0", b"#ROSBAG V1.2", "of version 1.2; expected 2.0"),
        (b"compression=none", b"compression=zzzz", "compressed with 'zzzz'"),
        (b"chunk_count=\1", b"chunk_count=\2", "1 chunks and 1 connections in its index"),
    ],
)
def test_other_bags_of_ros_1_are_told_apart(old, new, words, tmp_path):
    path = write_bag(tmp_path, "bag", {"/points": CLOUDS})
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new))
    assert words in read(path)[1]


def change(path, *statements):
    with sqlite3.connect(file_of(path)) as database:
        for statement in statements:
            database.execute(statement)
    database.close()


def test_metadata_is_held_against_the_messages(tmp_path):
    path = write_bag(tmp_path, "folder", {"/points": CLOUDS})
    change(path, "DELETE FROM messages WHERE id = 4")
    found, error = read(path)
    assert np.array_equal(found, np.delete(SCANS, 3, axis=0))
    assert "5 messages on /points read, but its index says 6" in error


@pytest.mark.parametrize("qos", ["", "garbage: [", "- history: 3\n", [{"depth": 1}], None])
def test_qos_profiles_have_no_part_in_reading(qos, tmp_path):
    path = write_bag(tmp_path, "folder", {"/points": CLOUDS})
    metadata = path / "metadata.yaml"
    whole = yaml.safe_load(metadata.read_text())
    topic = whole["rosbag2_bagfile_information"]["topics_with_message_count"][0]["topic_metadata"]
    topic["offered_qos_profiles"] = qos
    metadata.write_text(yaml.safe_dump(whole))
    assert all_or_an_error(path)
    change(path, "UPDATE topics SET offered_qos_profiles = '- {'")
    assert all_or_an_error(path)


@every_kind
def test_a_topic_without_messages_is_an_error(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/chat": ["hello"], "/points": []})
    with pytest.raises(
        DataError, match=r"drive.*topic /points has no messages; .*holds /chat .*, 1 message\), /p"
    ):
        next(bag_scans(path))


@pytest.mark.parametrize("kind", ["db3", "folder", "mcap"])
def test_compressed_messages_need_no_metadata(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/points": CLOUDS}, mode="message")
    assert all_or_an_error(path)


def test_compressed_files(tmp_path):
    path = write_bag(tmp_path, "folder", {"/points": CLOUDS}, mode="file")
    assert all_or_an_error(path)
    (file,) = path.glob("*.zstd")
    data = file.read_bytes()
    file.write_bytes(data + zstd.compress(b""))
    assert all_or_an_error(path)
    for cut in (0, 3, len(data) // 2, len(data) - 1):
        file.write_bytes(data[:cut])
        assert not all_or_an_error(path)
    file.write_bytes(zstd.compress(bytes(10**7)))
    assert "more than 1000 times its size" in read(path)[1]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("compression_format: ''", "compression_format: lz4", None),
        ("compression_mode: ''", "compression_mode: message", "compressed with '' by 'message'"),
        ("storage_identifier: sqlite3", "storage_identifier: avro", "stored as 'avro'; expected"),
        ("- drive.db3", "- ../drive.db3", None),
        ("- drive.db3", "- drive_0.db3", "names drive_0.db3, which is missing"),
        ("- drive.db3", "- /etc/passwd", "names passwd; expected a name with .db3"),
        ("- drive.db3", "- ..", "names ..; expected a name with .db3"),
        ("- drive.db3", "- drive.db3\n  - ./drive.db3", "names twice the same file"),
        ("\n  - drive.db3", " []", "names no files"),
        ("relative_file_paths:", "other:", "its metadata.yaml is damaged"),
        ("message_count: 6", "message_count: many", "its metadata.yaml is damaged"),
    ],
)
def test_metadata_that_cannot_be_followed_says_why(old, new, words, tmp_path):
    path = write_bag(tmp_path, "folder", {"/points": CLOUDS})
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    assert old in text
    metadata.write_text(text.replace(old, new))
    error = read(path)[1]
    assert error is None if words is None else words in error


def test_a_file_that_metadata_does_not_name_is_not_passed_over(tmp_path):
    path = write_bag(tmp_path, "folder", {"/points": CLOUDS})
    shutil.copy(path / "drive.db3", path / "._drive.db3")
    assert all_or_an_error(path)
    shutil.copy(path / "drive.db3", path / "drive_1.db3")
    assert "drive_1.db3 is in the folder and not in metadata.yaml" in read(path)[1]


def test_databases_run_nothing(tmp_path):
    path = write_bag(tmp_path, "db3", {"/points": CLOUDS})
    whole = path.read_bytes()
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n)"
    change(
        path,
        "ALTER TABLE messages RENAME TO stored",
        f"CREATE VIEW messages AS {endless} SELECT i AS topic_id, i AS timestamp, i AS data FROM n",
    )
    assert "no table messages with topic_id, timestamp, data" in read(path)[1]
    path.write_bytes(whole)
    change(path, "ALTER TABLE messages DROP COLUMN data")
    assert "no table messages" in read(path)[1]
    path.write_bytes(whole.replace(b"CREATE TABLE messages", b"CREATE TABLE \xff\xffssages"))
    assert "its database is damaged" in read(path)[1]
    path.write_bytes(whole)
    change(path, "UPDATE messages SET data = 'text' WHERE id = 3")
    found, error = read(path)
    assert len(found) == 2
    assert "2 of 6 messages on /points read: its table of messages is damaged" in error


def test_messages_that_are_lost_in_a_database_are_counted(tmp_path):
    path = write_bag(tmp_path, "db3", {"/points": CLOUDS})
    whole = path.read_bytes()
    change(path, "UPDATE messages SET topic_id = 99 WHERE id = 3")
    found, error = read(path)
    assert len(found) == 5
    assert "5 messages on /points read; " in error
    assert "1 messages are of no topic" in error
    path.write_bytes(whole)
    page, cells = 4096, 6
    header = b"\x0a" + bytes(2) + struct.pack(">H", cells)  # a leaf of an index with six rows
    at = next(k for k in range(0, len(whole), page) if whole[k : k + 5] == header)
    path.write_bytes(whole[: at + 3] + struct.pack(">H", cells - 1) + whole[at + 5 :])
    assert "6 messages, but 5 in their index" in read(path)[1]
    path.write_bytes(whole)
    change(path, "DROP INDEX timestamp_idx")
    assert all_or_an_error(path)


def test_a_database_whose_changes_lie_beside_it_is_not_closed(tmp_path):
    path = write_bag(tmp_path, "db3", {"/points": CLOUDS})
    for ending in ("wal", "journal"):
        beside = path.with_name(f"drive.db3-{ending}")
        beside.write_bytes(b"")
        assert all_or_an_error(path)
        beside.write_bytes(b"changes")
        assert f"drive.db3-{ending} beside it holds changes" in read(path)[1]
        beside.unlink()


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_pages_of_a_database_that_are_overwritten(share, tmp_path):
    path = write_bag(tmp_path, "db3", {"/points": CLOUDS * 40})
    data = bytearray(path.read_bytes())
    at = int(share * len(data)) // 4096 * 4096
    data[at : at + 4096] = bytes(4096)
    path.write_bytes(data)
    scans, error = read(path)
    assert error or len(scans) == 240


def test_zeros_anywhere_in_a_database(tmp_path):
    path = write_bag(tmp_path, "db3", {"/points": CLOUDS})
    whole, lost = path.read_bytes(), 0
    for at in range(0, len(whole) - 64, 64):
        path.write_bytes(whole[:at] + bytes(64) + whole[at + 64 :])
        scans, error = read(path)
        assert error or len(scans) == 6
        lost += bool(error)
    assert lost > 10


def test_missing_returns_are_dropped_and_a_message_of_them_is_broken(tmp_path):
    holes = SCANS.copy()
    holes[1, 2], holes[1, 3, 0], holes[1, 4] = 0, np.nan, np.inf
    holes[2] = 0
    holes[4, 0] = np.frombuffer(b"\x01\x00\x80\x7f" * 3, "<f4")  # NaN that raise a flag
    path = write_bag(tmp_path, "mcap", {"/points": [message(scan) for scan in holes]})
    scans = list(bag_scans(path))
    assert np.array_equal(scans[1].read(), SCANS[1, :2])
    with pytest.raises(BrokenScanError, match=r"/points at \d{19} ns: 5 records, all missing"):
        scans[2].read()
    assert np.array_equal(scans[3].read(), SCANS[3])
    assert np.array_equal(scans[4].read(), SCANS[4, 1:])


def test_other_bytes_in_place_of_a_message_are_named(tmp_path):
    path = tmp_path / "drive.mcap"
    records = [mcap.schema(), mcap.channel(), MESSAGES[0]]
    for bad in (b"", b"\0\1\0\0", b"\x04\x22\x4d\x18 lz4", b"\x28\xb5\x2f\xfd broken"):
        path.write_bytes(mcap.mcap(b"".join([*records, mcap.message(START + 5, bad), MESSAGES[1]])))
        first, second, third = bag_scans(path)
        assert second.stamp == START + 5
        with pytest.raises(BrokenScanError, match=rf"/points at {START + 5} ns: "):
            second.read()
        assert np.array_equal([first.read(), third.read()], SCANS[:2])


def test_a_bag_of_several_files_is_read_in_the_order_of_metadata(tmp_path):
    path = write_bag(tmp_path, "folder", {"/points": CLOUDS})
    shutil.copy(path / "drive.db3", path / "drive_1.db3")
    metadata = path / "metadata.yaml"
    text = metadata.read_text().replace("  - drive.db3", "  - drive_1.db3\n  - drive.db3")
    metadata.write_text(text.replace("message_count: 6", "message_count: 12"))
    found, error = read(path)
    assert error is None
    assert np.array_equal(found, [*SCANS, *SCANS])
    change(path, "UPDATE messages SET data = 3 WHERE id = 2")  # in the first that is found
    first = file_of(path).name
    found, error = read(path)
    assert f"of 12 messages on /points read: {first}: its table of messages" in error
    assert len(found) == (7 if first == "drive.db3" else 1)


def test_no_permission_is_no_damage(tmp_path, monkeypatch):
    path = write_bag(tmp_path, "mcap", {"/points": CLOUDS})

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", refuse)
    with pytest.raises(FileError, match=r"drive\.mcap: cannot be read: Permission denied"):
        next(bag_scans(path))


def test_libraries_are_asked_for_by_what_needs_them(tmp_path, monkeypatch):
    path = tmp_path / "drive.mcap"
    for module, data in (("lz4.frame", FORMS[0]), ("backports.zstd", FORMS[1])):
        path.write_bytes(data)
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(FileError, match=r"compressed with \w+, .*'deepring\[bags\]'"):
            list(bag_scans(path))


def test_names_from_a_bag_cannot_move_the_cursor(tmp_path):
    path = tmp_path / "drive.mcap"
    path.write_bytes(mcap.mcap(mcap.schema(name="\x1b[2J\nok") + mcap.channel(topic="/\x07")))
    error = read(path)[1]
    assert error.isprintable()
    assert r"\x1b[2J\nok" in error


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=st.sampled_from(KINDS), data=st.data())
def test_altered_bytes_end_in_scans_or_in_one_line(kind, data, tmp_path_factory):
    whole = _whole(kind, tmp_path_factory)
    path = tmp_path_factory.mktemp("altered") / "drive"
    if whole.is_dir():
        shutil.copytree(whole, path)
    else:
        path = path.with_suffix(whole.suffix)
        shutil.copy(whole, path)
    file = file_of(path)
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    scans, error = read(path)
    assert "\n" not in (error or "")
    assert error or len(scans) == 6


_BAGS = {}


def _whole(kind, tmp_path_factory):
    if kind not in _BAGS:
        _BAGS[kind] = write_bag(tmp_path_factory.mktemp("whole"), kind, {"/points": CLOUDS})
    return _BAGS[kind]
