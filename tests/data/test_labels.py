"""Classes and intensities of points, from the files of every layout to the rasters of scans."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deepring.core.rigid import turn_points
from deepring.data.cache import RasterCache, load_rasters
from deepring.data.readers import open_session
from deepring.data.scan_set import ScanSet
from deepring.data.scans.columns import label_path
from deepring.data.scans.labels import read_labels, write_labels
from deepring.errors import BrokenScanError, DataError
from deepring.rasters import BevRaster, SemanticRaster
from deepring.simulation.presets import tiny
from deepring.simulation.scene import Scene
from deepring.simulation.simulate import session_names, simulate


def kitti_drive(root, count=3, labels=True):
    """Scans in SemanticKITTI's layout: points on a circle, the k-th of label 10 k, one missing."""
    rng = np.random.default_rng(0)
    drive = root / "sequences" / "00"
    (drive / "velodyne").mkdir(parents=True)
    rows = "1 0 0 0 0 1 0 0 0 0 1 0\n"
    (drive / "poses.txt").write_text(rows * count)
    (drive / "calib.txt").write_text(f"Tr: {rows}")
    for k in range(count):
        points = rng.uniform(-40, 40, (100, 4)).astype("<f4")
        points[7, :3] = 0
        scan = drive / "velodyne" / f"{k:06d}.bin"
        points.tofile(scan)
        if labels:
            classes = 10 * (1 + np.arange(100) % 8)
            label_path(scan).parent.mkdir(exist_ok=True)
            (classes + (np.arange(100) << 16)).astype("<u4").tofile(label_path(scan))
    return root


def test_semantickitti_has_the_class_in_the_low_bits_of_one_number_a_point(tmp_path):
    session = open_session("kitti", kitti_drive(tmp_path), "00")
    assert session.files[1].parent.name == "velodyne"
    assert label_path(session.files[1]) == tmp_path / "sequences/00/labels/000001.label"
    points = session.points(1, ("label", "intensity"))
    raw = np.fromfile(session.files[1], "<f4").reshape(-1, 4)
    kept = np.arange(100) != 7  # the missing return takes its label along
    np.testing.assert_array_equal(points[:, :3], raw[kept, :3])
    np.testing.assert_array_equal(points[:, 3], 10 * (1 + np.arange(100) % 8)[kept])
    np.testing.assert_array_equal(points[:, 4], raw[kept, 3])
    # The misreading: the instance is in the same number, above the class.
    assert np.fromfile(label_path(session.files[1]), "<u4").max() > 65535
    assert session.points(1).shape == (99, 3)


def out_of_plane(points):
    """Mean distance in z of near points to the plane that fits them."""
    x, y, z = points[np.hypot(*points[:, :2].T) < 12, :3].T
    plane = np.stack([x, y, np.ones_like(x)], axis=1)
    return np.abs(z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0]).mean()


@pytest.mark.parametrize("name", ["nclt", "mulran", "custom"])
def test_labels_of_simulated_scans_are_those_of_their_points(name, tmp_path):
    settings = replace(tiny(name), scan_spacing=50.0, labels=True)
    root = simulate(settings, tmp_path / "sim")
    drive = session_names(settings)[0]
    session = open_session(name, root / "drive.yaml" if name == "custom" else root, drive)
    sweep = Scene(settings).sweep(0, 1)
    points = session.points(1, ("label",))
    assert len(points) == sweep.valid.sum()
    road = points[:, 3] == 40
    assert out_of_plane(points[road]) < 0.1
    shifted = np.roll(road, len(road) // 2)  # labels in another order than the points
    assert out_of_plane(points[shifted]) > 0.3
    assert ("intensity" in session.columns) == (name != "custom")


def test_a_cropped_custom_scan_keeps_the_labels_of_what_is_left(tmp_path):
    points = np.random.default_rng(1).uniform(-40, 40, (200, 3)).astype(np.float32)
    points[5] = 0
    (tmp_path / "scans").mkdir()
    np.save(tmp_path / "scans" / "0.npy", points)
    write_labels(tmp_path / "scans" / "0.npy", np.arange(200, dtype=np.uint16))
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    (tmp_path / "drive.yaml").write_text(
        "pose_format: kitti\ndrives:\n  a:\n    scans: scans\n    poses: poses.txt\n"
        "    sensor_height: 1.8\n    azimuth: [-90, 45]\n    up: -y\n    world_up: -y\n"
    )
    found = open_session("custom", tmp_path / "drive.yaml", "a").points(0, ("label",))
    x, y, z = found[:, :3].T
    np.testing.assert_array_equal(np.stack([x, -z, y], 1), points[found[:, 3].astype(int)])
    assert 0 < len(found) < 150


def test_files_of_labels_that_are_short_cut_or_missing_are_told_apart(tmp_path):
    session = open_session("kitti", kitti_drive(tmp_path, 4), "00")
    short, cut, missing, whole = (label_path(file) for file in session.files)
    short.write_bytes(short.read_bytes()[:-4])
    cut.write_bytes(cut.read_bytes()[:-1])
    missing.unlink()
    for k, reason in enumerate(
        [
            r"000000\.label: 99 labels for the 100 points of 000000\.bin; expected one for each",
            r"000001\.label: 399 bytes; expected a multiple of 4",
            r"000002\.bin: no labels: .*000002\.label is missing; expected one file a scan",
        ]
    ):
        with pytest.raises(BrokenScanError, match=reason):
            session.points(k, ("label",))
        assert len(session.points(k)) == 99  # the scans themselves are whole
    assert len(read_labels(session.files[3])) == 100
    assert whole.is_file()


def test_a_dataset_without_labels_is_refused_in_one_line_before_a_scan_is_read(tmp_path):
    session = open_session("kitti", kitti_drive(tmp_path, labels=False), "00")
    scans = ScanSet(session, np.arange(3), -1.73)
    for file in session.files:
        Path(file).unlink()
    with pytest.raises(DataError, match=r"^session 00: its points have no labels in .*labels, ex"):
        load_rasters(RasterCache(tmp_path / "cache"), scans, SemanticRaster(), "queries")
    with pytest.raises(DataError, match="its points have no colours, expected"):
        session.expect_columns(["colour"])


def test_changed_labels_are_drawn_again_and_change_no_other_raster(tmp_path):
    session = open_session("kitti", kitti_drive(tmp_path), "00")
    scans = ScanSet(session, np.arange(3), -1.73, np.array([0.0, 1.0, 2.0]))
    cache, raster = RasterCache(tmp_path / "cache"), SemanticRaster()
    _, first, _ = cache.load(scans, raster)
    for k in range(3):
        points = session.points(k, ("label",))
        points[:, :3] = turn_points(points[:, :3], float(k))
        np.testing.assert_array_equal(first[k].numpy(), raster(points, -1.73))
    bev = BevRaster(cells=24)
    cache.load(scans, bev)
    before = label_path(session.files[1]).stat()
    write_labels(session.files[1], np.full(100, 50, dtype=np.uint16))
    os.utime(label_path(session.files[1]), ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    _, second, _ = cache.load(scans, raster)
    assert set(np.unique(second[1].numpy())) == {0, 13}  # building
    for k in (0, 2):
        assert np.array_equal(second[k].numpy(), first[k].numpy())
    for file in session.files:
        label_path(file).unlink()
    calls = []
    object.__setattr__(session, "read", calls.append)
    assert cache.load(scans, bev)[2] == ()
    assert not calls  # occupancy does not look at labels
