"""Reports on datasets: what they hold, what is doubtful, and the worst of it, as text and JSON."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from deepring.data.inspection.check import check
from deepring.data.inspection.check_json import report_json
from deepring.data.inspection.check_text import report_lines
from deepring.data.readers import open_session
from deepring.errors import DeepringError
from helpers.schemas import expect_valid
from helpers.wrong_scans import rows, write_wrong

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


def test_the_figures_of_a_session(tmp_path):
    write_drive(tmp_path, "DCC01", [0, 100, 200], [0, 3, 7], [5, 9, 6])
    seen = []
    (report,) = check(tmp_path, progress=lambda *step: seen.append(step))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert (report.format, report.name, report.scans, report.readable) == ("mulran", "DCC01", 3, 3)
    assert report.span_s == pytest.approx(0.2)
    assert report.path_m == pytest.approx(7)
    assert report.points == (5, 6, 9)
    assert report.time_gaps.count == report.jumps.count == 0
    lines = report_lines([report])
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
    assert (report.scans, report.readable, report.without_pose) == (5, 4, 1)
    assert len(report.broken) == 7
    assert (report.time_gaps.count, report.time_gaps.largest) == (2, 3.0)
    assert (report.jumps.count, report.jumps.largest) == (1, 28.0)
    text = "\n".join(report_lines([report]))
    assert "2 gaps > 1 s, the largest 3.0 s" in text
    assert "1 jump > 10 m, the largest 28.0 m" in text
    assert text.count("\n  broken  ") == 4 + 1  # the first is a finding, and the last counts
    assert "and 2 more files" in text
    assert "7 of 11 cannot be read" in text


def test_a_session_of_unreadable_scans_is_not_usable(tmp_path):
    scans = write_drive(tmp_path, "DCC01", [0, 100], [0, 1], [5, 5])
    for file in scans.iterdir():
        file.write_bytes(bytes(32))
    (report,) = check(tmp_path)
    assert report.verdict == "unusable"
    assert report.points is None
    assert "2 of 2 cannot be read" in "\n".join(report_lines([report]))


def test_one_session_that_cannot_be_opened_does_not_hide_the_others(tmp_path):
    write_drive(tmp_path, "DCC01", [0, 100], [0, 1], [5, 5])
    write_drive(tmp_path, "DCC02", [0, 100], [0, 1], [5, 5])
    (tmp_path / "DCC02" / "global_pose.csv").write_text("99000000000000,1,0,0,0,0,1,0,0,0,0,1,0\n")
    first, second = check(tmp_path)
    assert first.readable == 2
    assert second.verdict == "unusable"
    assert "no pose within" in second.problem
    assert "cannot be opened: no pose" in "\n".join(report_lines([first, second]))


def test_a_drive_without_time_stamps(tmp_path):
    (tmp_path / "velodyne").mkdir()
    for i in range(3):
        (tmp_path / "velodyne" / f"{i:06d}.bin").write_bytes(struct.pack("<ffff", 1, 1, 1, 1))
    poses = [f"1 0 0 {20 * i} 0 1 0 0 0 0 1 0" for i in range(3)]
    (tmp_path / "poses.txt").write_text("\n".join(poses))
    (tmp_path / "calib.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0")
    (report,) = check(tmp_path)
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


#: The keys that docs/datasets.md states, of a session.
KEYS = {
    *("name", "format", "verdict", "problem", "scans", "readable", "without_pose", "bad_poses"),
    *("broken", "span_s", "time_gaps", "repeated_stamps", "path_m", "jumps", "points", "missing"),
    *("distance", "span_x", "span_y", "span_z", "ground_z", "ground_found", "overlay", "findings"),
}


@pytest.fixture(scope="module")
def street(tiny_mulran):
    session = open_session("mulran", tiny_mulran, "SimCity01")
    indices = range(0, 24, 3)
    return [session.points(k) for k in indices], session.poses[list(indices)]


@pytest.mark.parametrize("name", ["tiny_nclt", "tiny_mulran"])
def test_simulated_datasets_are_good(name, request):
    for report in check(request.getfixturevalue(name)):
        assert report.findings == ()
        assert report.verdict == "good"
        assert "fit by their poses" in report.overlay
        assert report.points[0] > 1000
    assert "nothing doubtful" in "\n".join(report_lines([report]))


def test_verdicts_and_advice_are_shown(street, tmp_path):
    """Good, doubtful for its ground, unusable for its types: all in one dataset."""
    for name, kind in (("00", "right"), ("01", "right"), ("02", "five values")):
        write_wrong(tmp_path / "sequences" / name, kind, *street)
    scans = sorted((tmp_path / "sequences" / "01" / "velodyne").iterdir())
    scans[2].write_bytes(scans[1].read_bytes())
    reports = check(tmp_path)
    assert [report.verdict for report in reports] == ["good", "doubtful", "unusable"]
    assert "1 of 7 files are byte for byte" in str(reports[1].findings[0])
    assert "5 values" in reports[2].findings[0].advice
    assert reports[0].ground_found == pytest.approx(-1.8, abs=0.2)
    assert reports[2].ground_found is None
    lines = report_lines(reports)
    assert sum("-> " in line for line in lines) == sum(len(r.findings) for r in reports) == 2
    short = [line for line in lines if str(tmp_path) not in line]
    assert max(map(len, short)) <= 100
    for word in ("nothing doubtful", "doubtful: ", "cannot be used", "ground", "points"):
        assert any(word in line for line in lines)


def test_json_states_every_key_and_no_nan(street, tmp_path):
    write_wrong(tmp_path / "sequences" / "00", "right", *street)
    write_wrong(tmp_path / "sequences" / "01", "big-endian", *street)
    folder = write_wrong(tmp_path / "sequences" / "02", "right", *street)
    (folder / "calib.txt").write_text("nothing\n")
    reports = check(tmp_path)
    content = json.loads(report_json(tmp_path, reports, 2))
    expect_valid("dataset_check", content)
    for session, report in zip(content["sessions"], reports, strict=True):
        assert set(session) == KEYS
        assert session["verdict"] == report.verdict
        assert session["scans"] == report.scans
        for finding in session["findings"]:
            assert set(finding) == {"subject", "found", "advice", "unusable"}
    assert [session["verdict"] for session in content["sessions"]] == ["good"] + ["unusable"] * 2
    assert "expected a line 'Tr:'" in content["sessions"][2]["problem"]
    empty = replace(reports[0], figures=replace(reports[0].figures, missing=np.nan))
    assert json.loads(report_json(tmp_path, [empty], 0))["sessions"][0]["missing"] is None


def test_missing_returns_are_counted(street, tmp_path):
    folder = write_wrong(tmp_path / "drive", "right", *street)
    for file, points in zip(sorted((folder / "velodyne").iterdir()), street[0], strict=True):
        records = np.repeat(rows(points, 4), 2, axis=0)
        records[1::2, :3] = np.nan
        file.write_bytes(records.tobytes())
    (report,) = check(folder)
    assert report.figures.missing == 0.5
    assert report.verdict == "good"
    assert "50% of the records miss a return" in "\n".join(report_lines([report]))


def test_few_broken_scans_are_doubted_and_many_refused(street, tmp_path):
    folder = write_wrong(tmp_path / "drive", "right", *street)
    files = sorted((folder / "velodyne").iterdir())
    for count, verdict in ((1, "doubtful"), (2, "unusable")):
        files[count].write_bytes(bytes(160))
        (report,) = check(folder)
        assert report.verdict == verdict
        assert f"{count} of 8 cannot be read" in report.findings[0].found
