import importlib.metadata
import re
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from deepring.data import readers
from deepring.data.readers import (
    binary_formats,
    detect_format,
    ground_of,
    list_sessions,
    open_session,
    reader_names,
    reader_of,
)
from deepring.data.scans.scan_files import read_scan
from deepring.errors import DeepringError

CONF = Path(__file__).parents[2] / "conf" / "data"
DOCS = Path(__file__).parents[2] / "docs" / "extending.md"
POSE = "1 0 0 {x} 0 1 0 0 0 0 1 0"


def make_nclt(root, name="2012-02-04"):
    scans = root / name / "velodyne_sync"
    scans.mkdir(parents=True)
    (scans / "1000000.bin").write_bytes(struct.pack("<HHHBB", 1, 2, 3, 4, 5))
    (root / name / f"groundtruth_{name}.csv").write_text("1000000,1,2,3,0,0,0\n")


def make_mulran(root, name="Sejong01"):
    scans = root / name / "Ouster"
    scans.mkdir(parents=True)
    (scans / "1000000.bin").write_bytes(struct.pack("<ffff", 1, 2, 3, 4))
    pose = POSE.format(x=7).replace(" ", ",")
    (root / name / "global_pose.csv").write_text(f"1000000,{pose}\n")


def make_kitti(root, name="00"):
    drive = root / "sequences" / name
    (drive / "velodyne").mkdir(parents=True)
    (drive / "velodyne" / "000000.bin").write_bytes(struct.pack("<ffff", 1, 2, 3, 4))
    (drive / "poses.txt").write_text(POSE.format(x=7) + "\n")
    (drive / "calib.txt").write_text("Tr: " + POSE.format(x=0) + "\n")


#: The formats that a folder has; "custom" is told by a file, and has tests of its own.
MAKERS = {"nclt": make_nclt, "mulran": make_mulran, "kitti": make_kitti}


def test_readers_are_found_by_the_names_of_their_modules():
    assert {*MAKERS, "custom"} <= set(reader_names())
    for name in reader_names():
        reader = reader_of(name)
        assert reader.name == name
        assert reader.layouts
        assert reader.signatures or reader.file_endings


def test_readers_are_imported_when_they_are_needed():
    """What a command's --help lists costs neither a reader's imports nor SciPy's."""
    code = (
        "import sys; from deepring.data.readers import reader_names; reader_names(); "
        "print([m for m in sys.modules if m.startswith('deepring.data.readers.')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['deepring.data.readers.reader']"


@pytest.mark.parametrize("name", reader_names())
def test_every_reader_has_a_config_with_its_ground(name):
    config = yaml.safe_load((CONF / f"{name}.yaml").read_text(encoding="utf-8"))
    assert config["name"] == config["format"] == name
    assert config["ground_z"] == reader_of(name).ground_z


def test_binary_formats_are_those_of_the_readers_and_have_a_ground():
    formats = binary_formats()
    assert set(MAKERS) <= set(formats)
    for name, scans in formats.items():
        assert -3 < scans.ground_z < 3, name
        assert all(record.itemsize > 6 for record in scans.records), name


def test_a_reader_from_outside_is_taken_as_any_other(tmp_path, monkeypatch):
    """The example of the docs, as it stands there."""
    text = DOCS.read_text(encoding="utf-8")
    (code,) = [
        block for block in re.findall(r"```python\n(.*?)```", text, re.S) if "READER" in block
    ]
    monkeypatch.setattr(readers, "_registered", {})
    exec(compile(code, "extending.md", "exec"), scope := {})
    with pytest.raises(DeepringError, match=r"reader\.name: 'mine', expected a name other"):
        scope["register_reader"](scope["READER"])
    scans = tmp_path / "monday" / "lidar"
    scans.mkdir(parents=True)
    for k in range(3):
        np.array([[k, 1, 2, 0], [0, 0, 0, 0]], "<f4").tofile(scans / f"{k}.bin")
    tum = "".join(f"{k} {5 * k} 0 0 0 0 0 1\n" for k in range(3))
    (tmp_path / "monday" / "lidar_poses.txt").write_text(tum)
    assert detect_format(tmp_path) == "mine"
    session = open_session("mine", tmp_path)
    assert session.name == "monday"
    np.testing.assert_array_equal(session.positions, [[0, 0], [5, 0], [10, 0]])
    np.testing.assert_array_equal(session.points(2), [[2, 1, 2]])
    assert ground_of(session, "mine") == -1.5
    np.testing.assert_array_equal(read_scan(scans / "2.bin", "mine"), [[2, 1, 2]])
    with pytest.raises(DeepringError, match="My LiDAR: no scans of session 'sunday'"):
        open_session("mine", tmp_path / "monday", "sunday")


def test_a_reader_of_an_installed_package_is_found_by_its_entry_point(monkeypatch):
    entry = SimpleNamespace(name="theirs", load=lambda: replace(reader_of("kitti"), name="theirs"))
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **_: [entry])
    readers._entry_points.cache_clear()
    try:
        assert "theirs" in reader_names()
        assert reader_of("theirs").title == "KITTI"
    finally:
        readers._entry_points.cache_clear()


@pytest.mark.parametrize("format", MAKERS)
def test_a_data_set_is_recognised_listed_and_opened(tmp_path, format):
    MAKERS[format](tmp_path)
    assert detect_format(tmp_path) == format
    (name,) = list_sessions(format, str(tmp_path))
    for chosen in (name, None):
        session = open_session(format, tmp_path, chosen)
        assert len(session) == 1
        assert session.name == name
        # What rasters in people's caches are kept under; NCLT's had zeros as points once.
        assert session.decoding == (f"{format}, zeros missing" if format == "nclt" else format)
        assert session.points(0).shape == (1, 3)
        assert session.points(0).dtype == np.float32


@pytest.mark.parametrize("format", MAKERS)
@pytest.mark.parametrize("other", MAKERS)
def test_a_wrong_format_is_told_the_right_one(tmp_path, format, other):
    if format == other:
        return
    MAKERS[other](tmp_path)
    with pytest.raises(DeepringError, match=f"use format {other}"):
        list_sessions(format, tmp_path)
    with pytest.raises(DeepringError, match=f"use format {other}"):
        open_session(format, tmp_path, "any")


def test_options_reach_the_opener(tmp_path):
    make_mulran(tmp_path)
    bare = open_session("mulran", tmp_path, "Sejong01", extrinsic="none", pose_tolerance=0.01)
    np.testing.assert_array_equal(bare.ground_truth, [[7, 0]])
    with pytest.raises(DeepringError, match="option 'extrinsic' of format nclt, expected one of p"):
        open_session("nclt", tmp_path, extrinsic="tf")
    with pytest.raises(DeepringError, match="option 'pose_tolerance' of format kitti, expected no"):
        open_session("kitti", tmp_path, pose_tolerance=0.1)


def test_one_of_several_sessions_must_be_named(tmp_path):
    make_mulran(tmp_path)
    make_mulran(tmp_path, "Sejong02")
    with pytest.raises(
        DeepringError, match=r"2 sessions \(Sejong01, Sejong02\), expected the name of one"
    ):
        open_session("mulran", tmp_path)


def test_folders_that_are_nothing_or_too_much(tmp_path):
    with pytest.raises(DeepringError, match=r"no dataset[\s\S]*KITTI: [\s\S]*MulRan: [\s\S]*NCLT"):
        detect_format(tmp_path)
    with pytest.raises(DeepringError, match="no scans of any session"):
        list_sessions("nclt", tmp_path)
    make_nclt(tmp_path / "nclt")
    make_kitti(tmp_path / "kitti")
    with pytest.raises(DeepringError, match=r"several formats \(kitti, nclt\)"):
        detect_format(tmp_path)
    with pytest.raises(DeepringError, match="does not exist"):
        detect_format(tmp_path / "none")
    (tmp_path / "file").touch()
    with pytest.raises(DeepringError, match="is a file"):
        detect_format(tmp_path / "file")


def test_a_link_that_cannot_be_followed_is_no_folder(tmp_path):
    (tmp_path / "link").symlink_to("x" * 300)  # too long a name for the system
    with pytest.raises(DeepringError, match=rf"{tmp_path}"):
        detect_format(tmp_path)


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(DeepringError, match=r"format: 'oxford', expected one of custom, .*nclt"):
        open_session("oxford", tmp_path)
