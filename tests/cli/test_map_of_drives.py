"""Maps of several drives and of bags, from the command line."""

from functools import partial

import numpy as np
import pytest

from deepring.data.readers.nclt import open_nclt
from deepring.localization.drives.trajectory_files import tum_lines
from deepring.localization.map import Map
from helpers.bags import START, message, write_bag
from helpers.cli import deepring, refused
from helpers.clouds import pcd_bytes

STEP = 10**8


@pytest.fixture
def here(tmp_path):
    """Runs a command in tmp_path."""
    return partial(deepring, cwd=tmp_path)


@pytest.fixture(scope="module")
def drive(tiny_nclt):
    return open_nclt(tiny_nclt, "2031-02-04")


@pytest.fixture(scope="module")
def whole(drive):
    """Rows of scans that are 5 m and more apart."""
    rows = [0]
    for k in range(1, len(drive.files)):
        if np.hypot(*(drive.positions[k] - drive.positions[rows[-1]])) > 5:
            rows.append(k)
    return rows


def write_tum(path, poses, stamps):
    path.write_text("".join(f"{line}\n" for line in tum_lines(poses, np.array(stamps))))


def bag_of(drive, folder, count=8, poses=None):
    """A bag of the first scans, and the poses of all of them but for the last."""
    bag = write_bag(folder, "mcap", {"/points": [message(drive.points(k)) for k in range(count)]})
    stamps = [START + k * STEP for k in range(count)]
    write_tum(folder / "bag.tum", drive.poses[: count - 1], stamps[:-1])
    return bag


def test_a_bag_with_poses_becomes_the_map_of_its_drive(drive, tmp_path, here):
    bag = bag_of(drive, tmp_path)
    done = here("map", "build", bag, "--poses", "bag.tum", "-o", "a.map", "--spacing", 3,
                "--ground-z", 0, "--points")  # fmt: skip
    assert done.returncode == 0, done.stderr
    place_map = Map.open(tmp_path / "a.map", check=True)
    assert place_map.source == "drive drive"
    rows = [0]
    for k in range(1, 7):
        if np.hypot(*(drive.positions[k] - drive.positions[rows[-1]])) > 3:
            rows.append(k)
    assert len(place_map) == len(rows) > 1
    np.testing.assert_allclose(place_map.places.poses, drive.poses[rows], atol=1e-6)
    assert str(START + rows[-1] * STEP) in place_map.places.names[-1]
    location = place_map.localize(drive.points(rows[1]))
    assert location.name == place_map.places.names[1]
    assert place_map.points.count > 100 * len(rows)


def test_poses_of_a_bag_are_asked_for_and_have_to_be_its_own(drive, tmp_path, here):
    bag = bag_of(drive, tmp_path, count=4)
    build = ("map", "build", bag, "-o", "a.map", "--ground-z", 0)
    refused(here(*build), "--poses: 0 files, expected one for each bag", "deepring loops")
    refused(here(*build, "--poses", "bag.tum", "--poses", "bag.tum"), "--poses: 2 files")
    refused(here(*build, "--poses", "absent.tum"), "absent.tum")
    write_tum(tmp_path / "other.tum", drive.poses[:4], [k * STEP for k in range(4)])
    refused(here(*build, "--poses", "other.tum"), "0 of 4 scans have a pose", "clock")
    refused(here(*build, "--poses", "bag.tum", "--spacing", -1), "--spacing: -1")
    assert not (tmp_path / "a.map").exists()


def test_poses_that_no_drive_has_are_refused(drive, tmp_path, here):
    bag = bag_of(drive, tmp_path)
    build = ("map", "build", bag, "-o", "a.map", "--ground-z", 0, "--poses")
    stamps = [START + k * STEP for k in range(7)]
    millimetres = drive.poses[:7] * np.array([1, 1, 1, 1000.0])[None, None]
    write_tum(tmp_path / "mm.tum", millimetres, stamps)
    refused(here(*build, "mm.tum"), "mm.tum cannot be used", "if they are millimetres")
    wrong = drive.poses[:7].copy()
    wrong[:, :3, :3] = wrong[:, :3, :3] @ np.diag([1.0, -1.0, -1.0])
    write_tum(tmp_path / "tilted.tum", wrong, stamps)
    refused(here(*build, "tilted.tum"), "tilted.tum cannot be used", "poses:")
    write_tum(tmp_path / "few.tum", drive.poses[:3], stamps[:3])
    refused(here(*build, "few.tum"), "5 of 8 scans have no pose within 0.1 s", "(--poses)")
    assert not (tmp_path / "a.map").exists()


def test_a_map_remembers_what_was_doubtful_about_its_drive(drive, tmp_path, here):
    bag = bag_of(drive, tmp_path)
    jump = drive.poses[:7].copy()
    jump[3, 0, 3] += 5e3
    write_tum(tmp_path / "jump.tum", jump, [START + k * STEP for k in range(7)])
    build = ("--ground-z", 0, "--poses", "jump.tum", "--spacing", 0)
    done = here("map", "build", bag, "-o", "a.map", *build)
    assert "1 of 8 scans have no pose within 0.1 s" in done.stderr
    doubt = "jump.tum: poses: 2 of 6 steps between neighbouring poses exceed 1000 m"
    assert f"warning: {doubt}" in done.stderr
    (kept,) = Map.open(tmp_path / "a.map").doubts
    assert kept.startswith(doubt)
    assert f"doubtful     {doubt}"[:60] in here("map", "info", "a.map").stdout
    located = here("localize", "a.map", bag, "--every", 8)
    assert f"warning: a.map: built from doubtful data: {doubt}" in located.stderr


def test_scans_of_a_folder_with_poses_are_a_drive_and_no_cloud(drive, tmp_path, here):
    (tmp_path / "scans").mkdir()
    for k in range(4):
        path = tmp_path / "scans" / f"{START + k * STEP}.pcd"
        path.write_bytes(pcd_bytes(drive.points(k)))
    write_tum(tmp_path / "a.tum", drive.poses[:4], [START + k * STEP for k in range(4)])
    build = ("map", "build", "scans", "-o", "a.map")
    refused(here(*build), "no pointcloud_map_metadata", "with their --poses")
    done = here(*build, "--poses", "a.tum", "--ground-z", 0)
    assert done.returncode == 0, done.stderr


def test_options_without_a_meaning_and_drives_given_twice_are_refused(tiny_nclt, tmp_path, here):
    build = ("map", "build", tiny_nclt, "-o", "a.map")
    refused(here(*build, "--topic", "/a"), "--topic: /a", "a bag")
    day = ("--session", "2031-02-04")
    refused(here(*build, *day, *day), "--session: 2031-02-04 is given twice")
    refused(here("map", "build", tiny_nclt, *build[2:]), "DATA:", "given twice")
    (tmp_path / "a.npy").write_bytes(b"")
    refused(here("map", "build", "a.npy", "-o", "a.map"), "DATA:", "a.npy is a file")
    refused(here("loops", "a.npy", "-o", "a"), "a.npy: one file, expected a bag")


@pytest.mark.parametrize("at", [[0] * 8, list(range(8))[::-1]])
def test_a_bag_whose_stamps_are_no_order_is_refused(drive, tmp_path, here, at):
    contents = [message(drive.points(k)) for k in range(8)]
    bag = write_bag(tmp_path, "mcap", {"/points": contents}, at=[START + k * STEP for k in at])
    write_tum(tmp_path / "bag.tum", drive.poses[:8], [START + k * STEP for k in range(8)])
    done = here("map", "build", bag, "--poses", "bag.tum", "-o", "a.map", "--ground-z", 0)
    refused(done, "scans cannot be used", "its stamp is not later than those before")
    assert not (tmp_path / "a.map").exists()


def test_several_sessions_and_folders_become_one_map(tiny_nclt, whole, tmp_path, here):
    both = ("--session", "2031-02-04", "--session", "2031-03-17", "--spacing", 5)
    done = here("map", "build", tiny_nclt, *both, "-o", "a.map")
    assert done.returncode == 0, done.stderr
    place_map = Map.open(tmp_path / "a.map")
    assert place_map.source == "drives 2031-02-04, 2031-03-17"
    alone = here(
        "map", "build", tiny_nclt, "--session", "2031-03-17", "--spacing", 5, "-o", "b.map"
    )
    assert alone.returncode == 0, alone.stderr
    second = Map.open(tmp_path / "b.map").places
    assert len(place_map) == len(whole) + len(second)
    np.testing.assert_array_equal(place_map.places.poses[len(whole) :], second.poses)
    assert place_map.places.names[len(whole) :] == second.names


def test_drives_that_do_not_go_together_are_refused(tiny_nclt, drive, tmp_path, here):
    bag = bag_of(drive, tmp_path, count=4)
    session = ("--session", "2031-02-04", "--poses", "bag.tum", "-o", "a.map")
    refused(here("map", "build", tiny_nclt, bag, *session), "--session", "one folder")
    for name, z in (("same", -1.0), ("lower", -2.5)):
        folder = tmp_path / name
        folder.mkdir()
        for k in range(3):
            np.save(folder / f"{k:06}.npy", drive.points(k) + np.float32([0, 0, z]))
        rows = [" ".join(map(str, pose[:3].ravel())) for pose in drive.poses[:3]]
        (tmp_path / f"{name}.txt").write_text("\n".join(rows))
        (tmp_path / f"{name}.yaml").write_text(
            f"scans: {name}\nposes: {name}.txt\nsensor_height: {-z}\n"
        )
    done = here("map", "build", "same.yaml", "lower.yaml", "-o", "a.map")
    refused(done, "the ground is at z = -1 m", "at -2.5 m", "deepring map merge")
    assert not (tmp_path / "a.map").exists()
    (tmp_path / "again.yaml").write_text((tmp_path / "same.yaml").read_text())
    assert here("map", "build", "same.yaml", "again.yaml", "-o", "a.map").returncode == 0
