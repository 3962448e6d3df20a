"""Scans of ROS 1 and ROS 2 bags; a bag without them says what it holds."""

import contextlib
import shutil
import sqlite3
import struct
import sys

import numpy as np
import pytest

from deepring.data.scans.bag_files import bag_scans, is_bag
from deepring.data.scans.bags.clouds import _decoders
from deepring.data.scans.scan_files import scan_files
from deepring.errors import BrokenScanError, DeepringError
from helpers.bags import KINDS, START, message, write_bag

SCANS = np.random.default_rng(0).normal(0, 20, (7, 40, 3)).astype(np.float32)
CLOUDS = [message(scan) for scan in SCANS]

every_kind = pytest.mark.parametrize("kind", KINDS)


@every_kind
def test_scans_come_with_the_stamps_of_their_headers(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/chat": ["hello"], "/points": CLOUDS})
    assert is_bag(path)
    found = list(bag_scans(path))
    assert [scan.stamp for scan in found] == [START + k * 10**8 for k in range(7)]
    assert np.array_equal([scan.read() for scan in found], SCANS)
    some = list(bag_scans(path, every=3))
    assert np.array_equal([scan.read() for scan in some], SCANS[::3])


@every_kind
def test_layouts_survive_the_bag(kind, tmp_path):
    cloud = message(SCANS[0], width=8, big=True, before=3, after=5, row_padding=6, rows=4)
    path = write_bag(tmp_path, kind, {"/points": [cloud]}, stamped=False)
    ((stamp, read, _),) = bag_scans(path)
    assert np.array_equal(read(), SCANS[0])
    assert stamp == START + 7  # that of the recording


@every_kind
def test_of_several_topics_one_is_named(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/left": CLOUDS[:2], "/right": CLOUDS[2:4], "/chat": ["a"]})
    with pytest.raises(DeepringError, match=r"drive.*on /left, /right; expected one topic"):
        next(bag_scans(path))
    found = [scan.read() for scan in bag_scans(path, "/right")]
    assert np.array_equal(found, SCANS[2:4])
    for topic, words in (("/up", "no point clouds"), ("/chat", "but std_msgs/msg/String")):
        with pytest.raises(
            DeepringError, match=rf"{words} on topic {topic}; expected /left or /right"
        ):
            next(bag_scans(path, topic))


@every_kind
def test_a_bag_without_clouds_lists_what_it_has(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/chat": ["hello"]})
    with pytest.raises(
        DeepringError,
        match=r"no point clouds among its topics, /chat \(std_msgs/msg/String, 1 message\)",
    ):
        next(bag_scans(path))


@every_kind
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.95])
def test_bags_that_are_cut_short_say_so(kind, share, tmp_path):
    path = write_bag(tmp_path, kind, {"/points": CLOUDS * 20})
    file = path / "drive.db3" if kind == "folder" else path
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    scans = []
    with pytest.raises(BrokenScanError, match=r"drive.*cut short or was not closed: .* try `"):
        scans.extend(bag_scans(path))


@every_kind
def test_files_of_other_content_are_broken_bags(kind, tmp_path):
    path = write_bag(tmp_path, kind, {"/points": CLOUDS})
    file = path / "metadata.yaml" if kind == "folder" else path
    file.write_bytes(b"rosbag2_bagfile_information: none of it\n" * 30)
    with pytest.raises(BrokenScanError, match="drive"):
        list(bag_scans(path))


@every_kind
def test_a_message_without_coordinates_is_named_and_the_next_one_follows(kind, tmp_path):
    flat = message(SCANS[1])
    flat.fields[0].name = "range"
    path = write_bag(tmp_path, kind, {"/points": [CLOUDS[0], flat, CLOUDS[2]]})
    first, second, third = bag_scans(path)
    at = START + 10**8
    with pytest.raises(BrokenScanError, match=rf"drive.*, /points at {at} ns: .*expected one x, y"):
        second.read()
    assert np.array_equal([first.read(), third.read()], SCANS[[0, 2]])


def test_the_library_is_asked_for(tmp_path, monkeypatch):
    path = write_bag(tmp_path, "bag", {"/points": CLOUDS[:1]})
    _decoders.cache_clear()
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(DeepringError, match=r"drive\.bag: .*pip install 'deepring\[bags\]'"):
        next(bag_scans(path))


def test_mistakes_are_named(tmp_path):
    with pytest.raises(DeepringError, match=r"none\.bag: no such file"):
        next(bag_scans(tmp_path / "none.bag"))
    with pytest.raises(DeepringError, match="every: 0"):
        next(bag_scans(tmp_path / "none.bag", every=0))


def test_bags_are_found_among_scans(tmp_path):
    folder = write_bag(tmp_path, "folder", {"/points": CLOUDS[:1]})
    assert scan_files([folder]) == [folder]
    (tmp_path / "both").mkdir()
    np.save(tmp_path / "both" / "z.npy", SCANS[0])
    shutil.copy(folder / "drive.db3", tmp_path / "both" / "a.db3")
    (tmp_path / "both" / "metadata.yaml").write_text("of something else")
    assert [p.name for p in scan_files([tmp_path / "both"])] == ["a.db3", "z.npy"]


def test_messages_come_in_the_order_of_the_table_not_of_its_index(tmp_path):
    path = write_bag(tmp_path, "db3", {"/points": CLOUDS[:4]})
    with contextlib.closing(sqlite3.connect(path)) as database:
        # The index of the stamps becomes one in which they fall.
        database.execute("CREATE INDEX other ON messages (-timestamp)")
        database.execute("PRAGMA writable_schema = ON")
        database.execute(
            "UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master "
            "WHERE name = 'other') WHERE name = 'timestamp_idx'"
        )
        database.execute("DELETE FROM sqlite_master WHERE name = 'other'")
        database.commit()
    assert [scan.stamp for scan in bag_scans(path)] == [START + k * 10**8 for k in range(4)]


def test_seconds_of_ros_1_are_unsigned(tmp_path):
    path = write_bag(tmp_path, "bag", {"/points": CLOUDS[:2]})
    before, after = (struct.pack("<I", seconds) for seconds in (START // 10**9, 2_200_000_000))
    path.write_bytes(path.read_bytes().replace(before, after))
    stamps = [scan.stamp for scan in bag_scans(path)]
    assert stamps == [2_200_000_000 * 10**9 + k * 10**8 for k in range(2)]
