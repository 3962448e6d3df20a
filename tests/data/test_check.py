import struct

import pytest

from deepring.data.check import check
from deepring.data.check_table import report_lines
from deepring.errors import DeepringError

MS = 1_000_000


def write_drive(root, name, times_ms, positions, counts):
    """A MulRan sequence whose scans have poses of exactly their stamps."""
    scans = root / name / "Ouster"
    scans.mkdir(parents=True)
    lines = []
    for time, x, count in zip(times_ms, positions, counts, strict=True):
        (scans / f"{time * MS}.bin").write_bytes(struct.pack("<ffff", 1, 1, 1, 1) * count)
        lines.append(f"{time * MS},1,0,0,{x},0,1,0,0,0,0,1,0")
    (root / name / "global_pose.csv").write_text("\n".join(lines) + "\n")
    return scans


def test_a_sound_session(tmp_path):
    write_drive(tmp_path, "DCC01", [0, 100, 200], [0, 3, 7], [5, 9, 6])
    seen = []
    (report,) = check(tmp_path, progress=lambda *step: seen.append(step))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert report.usable
    assert (report.format, report.name, report.scans, report.readable) == ("mulran", "DCC01", 3, 3)
    assert report.span_s == pytest.approx(0.2)
    assert report.path_m == pytest.approx(7)
    assert report.points == (5, 6, 9)
    assert report.time_gaps.count == report.jumps.count == 0
    lines = report_lines([report])
    assert len(lines) == 3
    assert lines[0].startswith("session")
    assert " ".join(lines[2].split()) == "DCC01 3 0 0 0 0.2 s 7 m 5 / 6 / 9"


def test_gaps_jumps_broken_files_and_missing_poses_are_reported(tmp_path):
    times = [0, 100, 1600, 1700, 4700]
    scans = write_drive(tmp_path, "DCC01", times, [0, 1, 2, 30, 31], [5] * 5)
    (scans / f"{100 * MS}.bin").write_bytes(bytes(16))  # possible size, no valid point
    for i in range(6):
        (scans / f"{10 + i}.bin").write_bytes(b"")
    (scans / f"{900_000 * MS}.bin").write_bytes(struct.pack("<ffff", 1, 1, 1, 1))
    (report,) = check(tmp_path, "mulran", "DCC01")
    assert report.usable
    assert (report.scans, report.readable, report.without_pose) == (5, 4, 1)
    assert len(report.broken) == 7
    assert (report.time_gaps.count, report.time_gaps.largest) == (2, 3.0)
    assert (report.jumps.count, report.jumps.largest) == (1, 28.0)
    text = "\n".join(report_lines([report]))
    assert "2 time gaps > 1 s, largest 3.0 s" in text
    assert "1 jumps > 10 m, largest 28.0 m" in text
    assert text.count("DCC01: broken: ") == 5
    assert "and 2 more broken files" in text


def test_a_session_of_unreadable_scans_is_not_usable(tmp_path):
    scans = write_drive(tmp_path, "DCC01", [0, 100], [0, 1], [5, 5])
    for file in scans.iterdir():
        file.write_bytes(bytes(32))
    (report,) = check(tmp_path)
    assert not report.usable
    assert report.points is None
    assert "not usable: none of its 2 scans" in "\n".join(report_lines([report]))


def test_one_session_that_cannot_be_opened_does_not_hide_the_others(tmp_path):
    write_drive(tmp_path, "DCC01", [0, 100], [0, 1], [5, 5])
    write_drive(tmp_path, "DCC02", [0, 100], [0, 1], [5, 5])
    (tmp_path / "DCC02" / "global_pose.csv").write_text("99000000000000,1,0,0,0,0,1,0,0,0,0,1,0\n")
    first, second = check(tmp_path)
    assert first.usable
    assert not second.usable
    assert "no pose within" in second.problem
    assert "DCC02: cannot be opened: no pose" in "\n".join(report_lines([first, second]))


def test_a_drive_without_time_stamps(tmp_path):
    (tmp_path / "velodyne").mkdir()
    for i in range(3):
        (tmp_path / "velodyne" / f"{i:06d}.bin").write_bytes(struct.pack("<ffff", 1, 1, 1, 1))
    poses = [f"1 0 0 {20 * i} 0 1 0 0 0 0 1 0" for i in range(3)]
    (tmp_path / "poses.txt").write_text("\n".join(poses))
    (tmp_path / "calib.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0")
    (report,) = check(tmp_path)
    assert report.usable
    assert report.name == tmp_path.name
    assert report.span_s is None
    assert report.time_gaps is None
    assert report.jumps.count == 2
    assert report_lines([report])[2].split()[5] == "-"


def test_wrong_folders_and_names_are_one_error(tmp_path):
    with pytest.raises(DeepringError, match="no dataset"):
        check(tmp_path)
    write_drive(tmp_path, "DCC01", [0], [0], [5])
    with pytest.raises(DeepringError, match=r"session: 'DCC09', expected one of DCC01"):
        check(tmp_path, session="DCC09")
    with pytest.raises(DeepringError, match="use format mulran"):
        check(tmp_path, "nclt")
    with pytest.raises(DeepringError, match="format: 'las'"):
        check(tmp_path, "las")
