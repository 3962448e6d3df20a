"""Git LFS pointers are called so, wherever a file is read."""

import numpy as np
import pytest

from deepring.data.readers import open_session
from deepring.data.scans.bag_files import bag_scans
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError, DeepringError
from deepring.io.git_lfs import is_lfs_pointer, is_lfs_pointer_file
from deepring.localization.map import Map
from helpers.bags import message, write_bag

POINTER = f"version https://git-lfs.github.com/spec/v1\noid sha256:{0:064d}\nsize {{}}\n"
WORDS = r"is a Git LFS pointer, not the file itself; fetch it with `git lfs pull`"


@pytest.mark.parametrize("size", ["123", "1234567", "12345678901"])  # 128, 132 and 136 bytes
@pytest.mark.parametrize("ending", ["bin", "npy", "pcd", "ply", "PCD"])
def test_scans(tmp_path, ending, size):
    path = tmp_path / f"a.{ending}"
    path.write_text(POINTER.format(size))
    for format in ("kitti", "nclt", "helipr_aeva", None):
        with pytest.raises(BrokenScanError, match=rf"a\.{ending}: {WORDS}"):
            read_scan(path, format)


def test_scans_of_drives(tmp_path):
    (tmp_path / "velodyne").mkdir()
    for k in range(2):
        (tmp_path / f"velodyne/{k}.bin").write_text(POINTER.format("123"))
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2)
    (tmp_path / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(DeepringError, match=rf"all 2 scans .*0\.bin: {WORDS}"):
        open_session("kitti", tmp_path)
    (tmp_path / "drive.yaml").write_text(
        "scans: velodyne\nposes: poses.txt\nformat: kitti\nsensor_height: 1.7\n"
    )
    with pytest.raises(DeepringError, match=rf"all 2 scans .*0\.bin: {WORDS}"):
        open_session("custom", tmp_path / "drive.yaml")


@pytest.mark.parametrize("ending", ["bag", "db3", "mcap", "MCAP"])
def test_bags(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    path.write_text(POINTER.format(1234567))
    with pytest.raises(BrokenScanError, match=rf"^bag \S+a\.{ending}: {WORDS}$"):
        list(bag_scans(path))


@pytest.mark.parametrize("mode", [None, "file"])
def test_files_of_bags_in_folders(tmp_path, mode):
    folder = write_bag(tmp_path, "folder", {"/points": [message(np.ones((4, 3)))]}, mode=mode)
    (file,) = folder.glob("drive.db3*")
    file.write_text(POINTER.format(1234567))
    with pytest.raises(BrokenScanError, match=rf"^bag \S+drive: drive\.db3\S* {WORDS}$"):
        list(bag_scans(folder))


def test_tables_and_descriptions(tmp_path):
    drive = tmp_path / "drive.yaml"
    drive.write_text(POINTER.format(77))
    with pytest.raises(DeepringError, match=rf"drive\.yaml: {WORDS}"):
        open_session("custom", drive)
    (tmp_path / "velodyne").mkdir()
    (tmp_path / "velodyne/0.bin").write_bytes(bytes([1]) * 16)
    (tmp_path / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    (tmp_path / "poses.txt").write_text(POINTER.format(77))
    with pytest.raises(DeepringError, match=rf"poses\.txt: {WORDS}"):
        open_session("kitti", tmp_path)
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    (tmp_path / "calib.txt").write_text(POINTER.format(77))
    with pytest.raises(DeepringError, match=rf"calib\.txt: {WORDS}"):
        open_session("kitti", tmp_path)


def test_maps(tmp_path):
    (tmp_path / "a.map").write_text(POINTER.format(1234567))
    with pytest.raises(DeepringError, match=rf"^map \S+a\.map: {WORDS}$"):
        Map.open(tmp_path / "a.map")


def test_other_files_are_none(tmp_path):
    text = POINTER.format(77).encode()
    assert is_lfs_pointer(text)
    assert not is_lfs_pointer(b"x" + text)
    assert not is_lfs_pointer(text + bytes(1024))  # no pointer is that long
    assert not is_lfs_pointer_file(tmp_path / "none")
    assert not is_lfs_pointer_file(tmp_path)
