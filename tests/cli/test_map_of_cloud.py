"""`deepring map build` of a point cloud: scans are located in it, mistakes are one clear error."""

import json
from functools import partial

import numpy as np
import pytest

from deepring.core.rigid import turn_points
from deepring.localization.clouds.virtual_scan import VirtualSensor, virtual_scan
from deepring.localization.map import Map
from helpers.cli import deepring, refused
from helpers.clouds import in_tiles, pcd_bytes, street

BUILD = ("map", "build")
HEIGHT = 1.9


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A street in world coordinates, and the path that was driven there."""
    folder = tmp_path_factory.mktemp("city")
    points = street(7)
    far = points + np.array([345600.0, 4037600.0, 80.0])
    (folder / "city.pcd").write_bytes(pcd_bytes(far, "f8"))
    rows = [f"{k} {345590 + k} 4037600 {80 + HEIGHT} 0 0 0 1" for k in range(21)]
    (folder / "poses.tum").write_text("\n".join(rows) + "\n")
    position = np.array([3.0, 1.0, HEIGHT])
    seen = virtual_scan(in_tiles(points), position, 0.4, VirtualSensor(height=HEIGHT))
    np.save(folder / "scan.npy", turn_points(seen, 1.0))
    return folder


@pytest.fixture
def here(tmp_path):
    return partial(deepring, cwd=tmp_path)


@pytest.mark.parametrize("path", [True, False])
def test_a_scan_is_located_in_the_clouds_coordinates(folder, here, tmp_path, path):
    options = ["--path", folder / "poses.tum"] if path else []
    options += ["--spacing", 6, "--height", HEIGHT, "--fov", -25, 20]
    done = here(*BUILD, folder / "city.pcd", *options, "-o", "city.map", "--points")
    assert done.returncode == 0, done.stderr
    row = json.loads(here("localize", "city.map", folder / "scan.npy", "--as", "jsonl").stdout)
    assert abs(row["x"] - 345603) < 2
    assert abs(row["y"] - 4037601) < 2
    assert abs(row["yaw"] + 1.0) < 0.1
    assert row["name"].startswith("pose_" if path else "place_")
    place_map = Map.open(tmp_path / "city.map", check=True)
    assert place_map.ground_z == -HEIGHT
    np.testing.assert_allclose(place_map.places.poses[:, 2, 3], 80 + HEIGHT, atol=0.1)
    assert len(place_map.points.of(0)) > 100
    said = here("map", "info", "city.map").stdout
    assert "cloud city.pcd" in said
    assert ("along a path" if path else "on a grid") in said
    assert "1.9 m above the ground from -25 to 20 degrees" in said


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--ground-z", "-1"], "--ground-z"),
        (["--session", "a"], "--session"),
        (["--fov", "20", "-25"], "--fov"),
        (["--height", "0"], "--height"),
        (["--path", "none.tum"], "none.tum"),
        (["--spacing", "0"], "--spacing"),
    ],
)
def test_wrong_options_are_named(folder, here, tmp_path, options, message):
    refused(here(*BUILD, folder / "city.pcd", *options, "-o", "city.map"), message)
    assert not list(tmp_path.iterdir())


def test_options_of_clouds_are_none_of_drives(tiny_nclt, here):
    for options in (["--path", "a"], ["--height", 2], ["--fov", -9, 9]):
        drive = [tiny_nclt, "--session", "2031-02-04"]
        refused(here(*BUILD, *drive, *options, "-o", "a.map"), options[0], "is a drive")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p * 1e3, "unit"),
        (lambda p: p[p[:, 2] > 1.0], "no ground"),
        (lambda p: p * np.nan, "NaN"),
        (lambda p: p[:, [0, 2, 1]], "vertical"),
    ],
)
def test_clouds_that_make_no_map_leave_nothing_behind(here, tmp_path, change, message):
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(change(street(8)), "f8"))
    refused(here(*BUILD, "a.pcd", "-o", "a.map"), "a.pcd", message)
    assert [one.name for one in tmp_path.iterdir()] == ["a.pcd"]


def test_the_metadata_stands_for_its_folder_and_radians_are_refused(here, tmp_path):
    metadata = "x_resolution: 200\ny_resolution: 200\na.pcd: [-100, -100]\n"
    (tmp_path / "pointcloud_map_metadata.yaml").write_text(metadata)
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(street(8)))
    build = (*BUILD, "pointcloud_map_metadata.yaml", "-o", "a.map", "--spacing", 40)
    refused(here(*build, "--fov", "-0.43", "0.35"), "--fov", "radians")
    done = here(*build)
    assert done.returncode == 0, done.stderr


def test_a_path_in_another_frame_is_refused(folder, here, tmp_path):
    (tmp_path / "b.tum").write_text("".join(f"{k} {k} 0 2 0 0 0 1\n" for k in range(50)))
    done = here(*BUILD, folder / "city.pcd", "--path", "b.tum", "-o", "b.map")
    refused(done, "--path", "lie beside it")


def test_a_missing_cloud_and_one_without_its_metadata(here, tmp_path):
    refused(here(*BUILD, "none.pcd", "-o", "a.map"), "none.pcd", "no such file")
    (tmp_path / "tiles").mkdir()
    for k in range(2):
        (tmp_path / "tiles" / f"{k}.pcd").write_bytes(pcd_bytes(street(k)))
    refused(here(*BUILD, "tiles", "-o", "a.map"), "2 .pcd files and no pointcloud_map_metadata")
