"""The files on disk, decoded here by independent readers of the native layouts."""

from dataclasses import replace

import numpy as np
import pytest

from deepring.simulation.mounting import hdl32e_upside_down, os1_64
from deepring.simulation.mulran_writer import write_scan as write_mulran
from deepring.simulation.nclt_writer import ground_truth
from deepring.simulation.nclt_writer import write_scan as write_nclt
from deepring.simulation.presets import tiny
from deepring.simulation.scene import Scene
from deepring.simulation.sensors import Sweep
from deepring.simulation.simulate import simulate
from deepring.simulation.split import UTM_ORIGIN

SETTINGS = {name: replace(tiny(name), scan_spacing=40.0) for name in ("nclt", "mulran")}


@pytest.fixture(scope="module")
def roots(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layouts")
    return {name: simulate(s, folder / name) for name, s in SETTINGS.items()}


def decode_nclt(path):
    """x, y, z (m, z down), intensity, laser: written without the package's own reader."""
    raw = np.frombuffer(path.read_bytes(), dtype=np.uint8).reshape(-1, 8)
    words = raw[:, :6].copy().view("<u2").astype(float)
    return words * 0.005 - 100.0, raw[:, 6], raw[:, 7]


def of(points, reflectance):
    """A sweep with these points, all equally bright."""
    grid = points.shape[:2]
    return Sweep(points, np.full(grid, reflectance), np.zeros(grid, np.uint16))


def decode_mulran(path):
    return np.fromfile(path, "<f4").reshape(-1, 4)


def test_nclt_points_come_back_within_half_a_unit(roots):
    scene = Scene(SETTINGS["nclt"])
    files = sorted((roots["nclt"] / "2031-02-04" / "velodyne_sync").iterdir())
    stamps = scene.drives[0].scan_stamps
    assert [int(f.stem) for f in files] == stamps.tolist()
    for index in (0, len(files) - 1):
        sweep = scene.sweep(0, index)
        points, intensity, laser = decode_nclt(files[index])
        body = sweep.points[sweep.valid] + [0.002, 0.004, 0.957]
        np.testing.assert_allclose(points * [1, -1, -1], body, atol=0.0025 + 1e-9)
        np.testing.assert_array_equal(laser, np.nonzero(sweep.valid)[1])
        assert intensity.max() > 0


def test_nclt_wall_on_the_left_is_at_negative_y_in_the_file(tmp_path):
    points = np.full((1, 32, 3), np.nan)
    points[0, 3] = [1.0, 12.0, 2.0]  # ahead, left, above the sensor
    write_nclt(tmp_path / "1.bin", of(points, 1.0), hdl32e_upside_down())
    decoded, intensity, laser = decode_nclt(tmp_path / "1.bin")
    np.testing.assert_allclose(decoded, [[1.002, -12.004, -2.957]], atol=0.0025)
    assert (intensity[0], laser[0]) == (255, 3)


def test_nclt_points_beyond_64_m_need_unsigned_words(tmp_path):
    points = np.full((1, 32, 3), np.nan)
    points[0, 0] = [90.0, 0.0, 0.0]
    write_nclt(tmp_path / "1.bin", of(points, 1.0), hdl32e_upside_down())
    assert decode_nclt(tmp_path / "1.bin")[0][0, 0] == pytest.approx(90.0, abs=0.005)
    assert np.fromfile(tmp_path / "1.bin", "<i2")[0] < 0  # the usual misreading


def test_nclt_ground_truth_rows(roots):
    path = roots["nclt"] / "ground_truth" / "groundtruth_2031-03-17.csv"
    table = np.loadtxt(path, delimiter=",")
    drive = Scene(SETTINGS["nclt"]).drives[1]
    assert np.isnan(table[:3, 1:]).all()
    assert np.isfinite(table[3:]).all()
    assert np.median(np.diff(table[:, 0])) == 10_000
    poses = drive.poses(table[3:, 0].astype(np.int64))
    np.testing.assert_allclose(table[3:, 1:4], poses[:, :3, 3] * [1, -1, -1], atol=1e-6)
    np.testing.assert_allclose(rebuilt(table[3:, 4:]), poses[:, :3, :3], atol=1e-6)


def rebuilt(rpy):
    """World <- body, z up, from NED roll, pitch, yaw: R = Rz Ry Rx, then both y and z flip."""
    flip = np.diag([1.0, -1.0, -1.0])
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy).T, np.sin(rpy).T
    one, nil = np.ones_like(cr), np.zeros_like(cr)
    rx = np.array([[one, nil, nil], [nil, cr, -sr], [nil, sr, cr]]).transpose(2, 0, 1)
    ry = np.array([[cp, nil, sp], [nil, one, nil], [-sp, nil, cp]]).transpose(2, 0, 1)
    rz = np.array([[cy, -sy, nil], [sy, cy, nil], [nil, nil, one]]).transpose(2, 0, 1)
    return flip @ rz @ ry @ rx @ flip


def test_a_left_turn_lowers_nclt_yaw():
    c, s = np.cos(0.3), np.sin(0.3)
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = [10.0, 4.0, 1.0]
    north, east, down, roll, pitch, yaw = ground_truth(pose[None])[0]
    assert (north, east, down) == (10.0, -4.0, -1.0)
    np.testing.assert_allclose([roll, pitch, yaw], [0.0, 0.0, -0.3], atol=1e-12)


def test_mulran_grid_ring_and_column_order(tmp_path):
    grid = np.full((6, 64, 3), np.nan)
    grid[5, 63] = [4.0, -0.5, 1.0]  # the last column counter-clockwise, the highest beam
    grid[0, 0] = [5.0, 0.0, -1.0]
    write_mulran(tmp_path / "1.bin", of(grid, 0.5), os1_64())
    rows = decode_mulran(tmp_path / "1.bin")
    assert len(rows) == 6 * 64
    filled = np.flatnonzero(rows.any(axis=1))
    assert [(i % 64, i // 64) for i in filled] == [(0, 0), (63, 5)]
    np.testing.assert_allclose(rows[filled, :3], [[4.0, -0.5, 1.0], [5.0, 0.0, -1.0]])


def test_mulran_scans_have_rings_a_blind_sector_and_zeros(roots):
    folder = roots["mulran"] / "SimCity01" / "Ouster"
    files = sorted(folder.iterdir(), key=lambda f: int(f.stem))
    for path in files[:3]:
        rows = decode_mulran(path)
        assert len(rows) == 64 * SETTINGS["mulran"].azimuths
        valid = rows[:, :3].any(axis=1)
        assert (rows[~valid] == 0).all()
        azimuth = np.rad2deg(np.arctan2(rows[:, 1], rows[:, 0]))
        assert np.abs(azimuth[valid]).min() >= 34.9
        ring = np.arange(len(rows)) % 64
        elevation = np.rad2deg(np.arctan2(rows[:, 2], np.hypot(rows[:, 0], rows[:, 1])))
        np.testing.assert_allclose(
            elevation[valid], np.linspace(16.6, -16.6, 64)[ring[valid]], atol=0.01
        )
        column = np.arange(len(rows)) // 64
        turned = np.diff(np.unwrap(np.deg2rad(azimuth[valid]))[np.argsort(column[valid])])
        assert np.median(turned[turned != 0]) < 0.01  # clockwise


def test_mulran_poses_are_the_base_in_utm(roots):
    folder = roots["mulran"] / "SimCity02"
    lines = (folder / "global_pose.csv").read_text().splitlines()
    stamps = np.array([int(line.split(",")[0]) for line in lines])
    table = np.array([[float(v) for v in line.split(",")[1:]] for line in lines])
    drive = Scene(SETTINGS["mulran"]).drives[1]
    poses = drive.poses(stamps // 1000)
    poses[:, :2, 3] += UTM_ORIGIN
    np.testing.assert_allclose(table.reshape(-1, 3, 4), poses[:, :3], atol=1e-6)
    assert 344_000 < table[:, 3].min() < table[:, 3].max() < 346_000
    assert 4_036_000 < table[:, 7].min() < table[:, 7].max() < 4_038_000
    listed = np.loadtxt(folder / "ouster_front_stamp.csv", dtype=np.int64)
    assert listed.tolist() == sorted(int(f.stem) for f in (folder / "Ouster").iterdir())


def test_mulran_lidar_faces_backwards_and_sees_the_ground_below_it(roots):
    scene = Scene(SETTINGS["mulran"])
    sweep, pose = scene.sweep(0, 4), scene.drives[0].poses(scene.drives[0].scan_stamps[4:5])[0]
    lidar = pose @ os1_64().mount
    np.testing.assert_allclose(lidar[:3, 0] @ pose[:3, 0], -1.0, atol=1e-3)
    world = sweep.points[sweep.valid] @ lidar[:3, :3].T + lidar[:3, 3]
    depth = world[:, 2] - scene.world.ground.height(world[:, 0], world[:, 1])
    assert depth.min() > -0.5
    assert (np.abs(depth) < 0.1).mean() > 0.2
