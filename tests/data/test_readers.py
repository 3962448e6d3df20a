import struct

import numpy as np
import pytest

from deepring.data.readers import detect_format, list_sessions, open_session, reader_names
from deepring.errors import DeepringError

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


def test_every_format_but_ones_own_is_a_folder():
    assert set(reader_names()) == {*MAKERS, "custom"}


@pytest.mark.parametrize("format", MAKERS)
def test_a_data_set_is_recognised_listed_and_opened(tmp_path, format):
    MAKERS[format](tmp_path)
    assert detect_format(tmp_path) == format
    (name,) = list_sessions(format, str(tmp_path))
    for chosen in (name, None):
        session = open_session(format, tmp_path, chosen)
        assert len(session) == 1
        assert session.name == name
        assert session.decoding == format  # what rasters in people's caches are kept under
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
    with pytest.raises(DeepringError, match="option 'extrinsic' of format nclt; expected one of p"):
        open_session("nclt", tmp_path, extrinsic="tf")
    with pytest.raises(DeepringError, match="option 'pose_tolerance' of format kitti; expected no"):
        open_session("kitti", tmp_path, pose_tolerance=0.1)


def test_one_of_several_sessions_must_be_named(tmp_path):
    make_mulran(tmp_path)
    make_mulran(tmp_path, "Sejong02")
    with pytest.raises(DeepringError, match=r"2 sessions \(Sejong01, Sejong02\): name one"):
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


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(
        DeepringError, match="format: 'oxford', expected one of custom, kitti, mulran, nclt"
    ):
        open_session("oxford", tmp_path)
