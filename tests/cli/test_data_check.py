"""The doctor of a dataset from the command line, and the part of it that other commands run."""

import json
import shutil
from functools import partial

import pytest

from deepring.data.readers import open_session
from helpers.cli import SMALL, deepring, refused
from helpers.wrong_scans import write_wrong

GROUND = ("--ground-z", "-1.8")


@pytest.fixture
def here(tmp_path):
    return partial(deepring, cwd=tmp_path)


@pytest.fixture(scope="module")
def street(tiny_mulran):
    """Points and poses of a simulated drive past the same places twice."""
    session = open_session("mulran", tiny_mulran, "SimCity01")
    indices = range(0, 24, 2)
    return [session.points(k) for k in indices], session.poses[list(indices)]


@pytest.fixture(scope="module")
def drives(street, tmp_path_factory):
    """Folders of a good drive, and of drives that are doubtful and unusable."""
    folder = tmp_path_factory.mktemp("drives")
    for name, kind in (("good", "right"), ("doubtful", "right"), ("float64", "float64")):
        write_wrong(folder / name, kind, *street)
    scans = sorted((folder / "doubtful" / "velodyne").iterdir())
    for k in range(6):  # so that the quick part sees it as well
        scans[2 * k + 1].write_bytes(scans[2 * k + 1].read_bytes()[: 16 * (2000 + k)])
    scans[3].write_bytes(scans[2].read_bytes())
    return folder


@pytest.mark.parametrize(("name", "status"), [("good", 0), ("doubtful", 1), ("float64", 2)])
def test_the_exit_status_tells_the_worst(name, status, drives, here):
    done = here("data", "check", drives / name)
    assert done.returncode == status, done.stdout
    shown = here("data", "check", drives / name, "--as", "json")
    assert shown.returncode == status
    content = json.loads(shown.stdout)
    assert content["status"] == status
    assert content["root"] == str(drives / name)
    (session,) = content["sessions"]
    assert bool(session["findings"]) == bool(status)
    for finding in session["findings"]:
        words = " ".join(done.stdout.split())
        assert finding["advice"].split(":")[0] in words


def test_a_session_that_cannot_be_opened_is_unusable(drives, tmp_path, here):
    shutil.copytree(drives / "good", tmp_path / "drive")
    (tmp_path / "drive" / "poses.txt").write_text("1 2 3\n")
    done = here("data", "check", "drive")
    assert done.returncode == 2
    assert "cannot be opened" in done.stdout
    content = json.loads(here("data", "check", "drive", "--as", "json").stdout)
    assert content["sessions"][0]["verdict"] == "unusable"
    assert "poses.txt" in content["sessions"][0]["problem"]


def test_scans_without_a_pose_and_broken_ones_are_doubts(drives, tmp_path, here):
    shutil.copytree(drives / "good", tmp_path / "drive")
    rows = (tmp_path / "drive" / "poses.txt").read_text().splitlines(keepends=True)
    (tmp_path / "drive" / "poses.txt").write_text("".join(rows[:-1]))
    done = here("data", "check", "drive")
    assert done.returncode == 1
    assert "1 of 12 scans have n" in done.stdout


def test_a_mistake_is_no_report(here):
    assert refused(here("data", "check", "nowhere"), "nowhere").returncode == 2


def work(name, drive, output):
    """The commands that take a drive, with their output."""
    return {
        "build": ("map", "build", drive, *GROUND, "--spacing", 5, "-o", output),
        "loops": ("loops", drive, *GROUND, "-o", output),
    }[name]


@pytest.mark.parametrize("name", ["build", "loops"])
def test_commands_refuse_an_unusable_drive_before_the_work(name, drives, tmp_path, here):
    done = here(*work(name, drives / "float64", "out"))
    refused(done, "session float64 cannot be used", "read as float64 with 4 values a point")
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["build", "loops"])
def test_commands_warn_of_a_doubtful_drive_and_go_on(name, drives, tmp_path, here):
    done = here(*work(name, drives / "doubtful", "out"))
    assert done.returncode == 0, done.stderr
    assert "warning: session doubtful: scans: " in done.stderr
    assert "byte for byte" in done.stderr
    assert list(tmp_path.iterdir())


def test_a_good_drive_gives_no_warning(drives, here):
    done = here(*work("build", drives / "good", "out"))
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr


def test_calibration_refuses_and_the_ground_is_doubted(drives, here):
    assert here(*work("build", drives / "good", "out")).returncode == 0
    calibrate = ("map", "calibrate", "out", "-o", "sure.map")
    refused(here(*calibrate, drives / "float64"), "cannot be used")
    done = here("map", "build", drives / "good", "--ground-z", "0", "-o", "other")
    assert "warning: session good: ground: the points show it at z = -1.8" in done.stderr


@pytest.mark.parametrize("command", ["train", "evaluate"])
def test_training_and_evaluation_refuse_unusable_data(command, drives, tmp_path, here):
    options = ["data=kitti", f"data.root={drives / 'float64'}", "evaluation.figures=false"]
    if command == "evaluate":
        options.append("method=ring")
    done = here(command, *options)
    refused(done, "session float64 cannot be used", "read as float64 with 4 values a point")


def test_training_and_evaluation_warn_of_doubtful_data(tiny_nclt, tmp_path, here):
    damaged = tmp_path / "damaged"
    shutil.copytree(tiny_nclt, damaged)
    scans = sorted((damaged / "2031-03-17" / "velodyne_sync").iterdir())
    scans[1].write_bytes(scans[0].read_bytes())
    data = [f"data.root={damaged}", "evaluate=false"]
    done = here("train", "experiment=demo", *SMALL, *data)
    assert done.returncode == 0, done.stderr
    told = done.stdout + done.stderr
    assert "sim_nclt 2031-03-17: scans: 1 of" in told
    assert "sim_nclt 2031-02-04: scans" not in told


def test_a_scan_of_another_format_is_not_located(drives, tiny_nclt, street, tmp_path, here):
    """A KITTI scan as NCLT's, and the other way round, at sizes that fit both."""
    assert here(*work("build", drives / "good", "out")).returncode == 0
    kitti = drives / "good" / "velodyne" / "000003.bin"
    scan = next((tiny_nclt / "2031-02-04" / "velodyne_sync").iterdir())
    nclt = tmp_path / "nclt.bin"
    nclt.write_bytes(scan.read_bytes()[: scan.stat().st_size // 16 * 16])
    assert here("localize", "out", kitti, "--format", "kitti").returncode == 0
    for file, wrong in ((kitti, "nclt"), (nclt, "kitti"), (nclt, "mulran")):
        done = here("localize", "out", file, "--format", wrong)
        refused(done, file.name, "expected")
        assert done.returncode == 2
