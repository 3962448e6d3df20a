"""`deepring loops` of scans without poses: a bag, a folder, a drive.yaml; and what goes wrong."""

import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from helpers.bags import START, message, write_bag
from helpers.cli import deepring, refused
from helpers.recorded_drives import HEIGHT, laps, seen_from, town

SCANS = 55
NAMES = [
    "a.g2o",
    "a.html",
    "a.json",
    "a.loops.txt",
    "a.png",
    "a_odometry.kitti",
    "a_odometry.tum",
    "a_optimized.kitti",
    "a_optimized.tum",
]


@pytest.fixture
def here(tmp_path):
    """Runs a command in tmp_path."""
    return partial(deepring, cwd=tmp_path)


@pytest.fixture(scope="module")
def drive():
    """A little more than a lap of a block: its true poses and its scans."""
    points, poses = town(), laps(SCANS, radius=12.0, rounds=1.35)
    return poses, [seen_from(points, pose) for pose in poses]


@pytest.fixture(scope="module")
def bag(drive, tmp_path_factory):
    return write_bag(
        tmp_path_factory.mktemp("bag"), "mcap", {"/points": list(map(message, drive[1]))}
    )


def write_tum(path, poses, stamps):
    from deepring.localization.drives.trajectory_files import tum_lines

    path.write_text("\n".join(tum_lines(poses, stamps)))


def test_a_bag_becomes_a_trajectory(bag, drive, tmp_path, here):
    poses, _ = drive
    stamps = START + np.arange(SCANS) * 10**8
    write_tum(tmp_path / "true.tum", poses, stamps)
    options = ["--optimize", "--fit", 0.2, "--recent", 50, "--poses", "true.tum"]
    done = here("loops", bag, *options, "-o", "out/a")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == NAMES
    found = json.loads((tmp_path / "out" / "a.json").read_text())
    assert found["poses"] == "odometry"
    assert found["ground_z"] == pytest.approx(-HEIGHT, abs=0.2)  # as the points show it
    assert found["stamps"] == stamps[found["rows"]].tolist()
    assert found["errors"]["odometry"]["absolute"]["rmse"] < 1.0
    assert found["errors"]["optimized"]["absolute"]["rmse"] < 1.0
    assert "deskewed     no" in done.stdout
    assert "ATE" in done.stdout
    rows = (tmp_path / "out" / "a_optimized.tum").read_text().splitlines()
    assert [int(row.split()[0].replace(".", "")) for row in rows] == stamps.tolist()
    html = (tmp_path / "out" / "a.html").read_text()
    assert html.count('class="line optimized"') == 2  # the line, and in the legend
    assert "http" not in html
    refused(here("loops", bag, "-o", "out/a"), "out/a.json exists")


def test_a_folder_and_a_drive_file_are_recordings_too(drive, tmp_path, here):
    _, scans = drive
    (tmp_path / "scans").mkdir()
    for k, scan in enumerate(scans[:12]):
        np.save(tmp_path / "scans" / f"{START + k * 10**8}.npy", scan)
    (tmp_path / "scans" / f"{START + 12 * 10**8}.npy").write_bytes(b"broken")
    done = here("loops", "scans", "-o", "a", "--ground-z", -HEIGHT)
    assert done.returncode == 0, done.stderr
    assert "left out 1 of 13 scans that cannot be used" in done.stderr
    rows = (tmp_path / "a_odometry.tum").read_text().splitlines()
    assert len(rows) == 12
    described = {"scans": "scans", "sensor_height": HEIGHT}
    (tmp_path / "drive.yaml").write_text(yaml.safe_dump(described))
    again = here("loops", "drive.yaml", "-o", "b", "--every", 2)
    assert again.returncode == 0, again.stderr
    assert len((tmp_path / "b_odometry.tum").read_text().splitlines()) == 6
    refused(here("map", "build", "drive.yaml", "-o", "m.map"), "drive.yaml: poses: missing")


def test_what_cannot_be_a_trajectory_is_refused(drive, tmp_path, here):
    _, scans = drive
    one = write_bag(tmp_path, "bag", {"/points": [message(scans[0])]})
    ground = ("--ground-z", -HEIGHT)
    refused(here("loops", one, *ground, "-o", "a"), "1 of 1 scans can be used", "at least 6")
    sparse = [message(scan[:: len(scan) // 60][:60]) for scan in scans[:4]]
    (tmp_path / "sparse").mkdir()
    few = write_bag(tmp_path / "sparse", "bag", {"/points": sparse})
    refused(here("loops", few, *ground, "-o", "a"), "cannot be used", "60 points", "at least 100")
    (tmp_path / "mixed").mkdir()
    worlds = [town(seed) for seed in range(6)]
    jumps = [message(seen_from(world, pose)) for world in worlds for pose in laps(80)[:7]]
    lost = write_bag(tmp_path / "mixed", "bag", {"/points": jumps})
    refused(here("loops", lost, *ground, "-o", "a"), "odometry was lost 4 times in 42 scans")
    raised = write_bag(
        tmp_path / "raised", "mcap", {"/p": [message(s[s[:, 2] > 1]) for s in scans[:3]]}
    )
    refused(here("loops", raised, "-o", "a"), "--ground-z: not given", "do not show it")
    refused(here("loops", "nothing.bag", "-o", "a"), "nothing.bag")
    apart = write_bag(tmp_path / "few", "mcap", {"/p": [message(s) for s in scans[:30:6]]})
    refused(here("loops", apart, *ground, "-o", "a"), "5 of 5 scans can be used", "at least 6")
    assert not list(tmp_path.glob("a*"))


def test_stamps_in_no_order_and_poses_in_another_unit_are_said(drive, tmp_path, here):
    poses, scans = drive
    contents = {"/p": [message(scan) for scan in scans[:8]]}
    bag = write_bag(tmp_path, "mcap", contents, at=[START + k // 2 * 10**8 for k in range(8)])
    millimetres = poses[:8] * np.array([1, 1, 1, 1000.0])
    write_tum(tmp_path / "true.tum", millimetres, START + np.arange(8) * 10**8)
    done = here("loops", bag, "--poses", "true.tum", "-o", "a", "--ground-z", -HEIGHT)
    assert "4 of 8 scans have a stamp that is not later" in done.stderr
    assert "warning: true.tum: poses:" in done.stderr


def test_true_poses_of_another_time_are_refused(bag, drive, tmp_path, here):
    poses, _ = drive
    write_tum(tmp_path / "true.tum", poses, START + np.arange(SCANS) * 10**8 + 10**12)
    done = here("loops", bag, "--poses", "true.tum", "-o", "a", "--every", 10)
    refused(done, "--poses: 0 of 6 scans have a pose within 0.1 s")
    assert not list(tmp_path.glob("a*"))


def test_points_with_times_are_deskewed(drive, tmp_path, here):
    _, scans = drive
    timed = []
    for scan in scans[:8]:
        cloud = message(scan, after=4)
        raw = cloud.data.reshape(len(scan), 16).copy()
        times = np.linspace(0, 99_000_000, len(scan)).astype("<u4")
        raw[:, 12:] = times[:, None].view(np.uint8)
        cloud.data = raw.ravel()
        cloud.fields.append(SimpleNamespace(name="t", offset=12, datatype=6, count=1))
        timed.append(cloud)
    path = write_bag(tmp_path, "bag", {"/points": timed})
    done = here("loops", path, "-o", "a")
    assert done.returncode == 0, done.stderr
    assert "deskewed     8 of 8 scans" in done.stdout
