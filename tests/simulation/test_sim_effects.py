"""Rosettes, tilted mountings, motion within a sweep, rain, and the files of labels."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.readers import open_session
from deepring.data.scans.columns import label_path
from deepring.errors import ConfigError
from deepring.simulation.fan import Fan
from deepring.simulation.manifest import NAME
from deepring.simulation.mounting import sensor_of
from deepring.simulation.patterns import SWEEP
from deepring.simulation.presets import custom, nclt, tiny, with_knobs
from deepring.simulation.rain import extinction
from deepring.simulation.scene import Scene
from deepring.simulation.sensor_models import SENSORS
from deepring.simulation.sensors import scan, scan_in_motion
from deepring.simulation.shapes import GROUNDS, PointClass, PrismList
from deepring.simulation.simulate import session_names, simulate
from helpers.raycasts import random_prisms, reference
from helpers.scenes import flat_ground

CLEAN = replace(
    custom(), range_noise=0.0, dropout_near=0.0, dropout_far=0.0, tilt_deg=0.0, azimuths=180
)
ROSETTES = [name for name, model in SENSORS.items() if model.rosette is not None]
TILTED = pose_from(rotation_from_rpy(0.06, -0.05, 2.1), [5.0, -3.0, 0.0])


def shoot(prisms, body_pose=None, seed=0, **knobs):
    """A sweep over level ground, and the sensor's pose in the world."""
    settings = replace(CLEAN, **knobs)
    sensor = sensor_of(settings, 0)
    body_pose = np.eye(4) if body_pose is None else body_pose
    rng = np.random.default_rng(seed)
    sweep = scan(sensor, body_pose, 0.1, prisms, flat_ground(), settings, rng)
    return sweep, body_pose @ sensor.mount


def in_world(sweep, pose):
    return sweep.points[sweep.valid] @ pose[:3, :3].T + pose[:3, 3]


@pytest.mark.parametrize("name", ROSETTES)
@pytest.mark.parametrize("upside_down", [False, True])
def test_a_rosettes_points_are_the_first_surfaces_on_their_rays(name, upside_down):
    prisms = random_prisms(150, np.random.default_rng(5))
    sweep, pose = shoot(prisms, TILTED, sensor=name, upside_down=upside_down)
    assert sweep.valid.sum() > 5000
    away = in_world(sweep, pose) - pose[:3, 3]
    level = np.hypot(away[:, 0], away[:, 1])
    rays = Rays(np.arctan2(away[:, 1], away[:, 0]), (away[:, 2] / level)[:, None])
    moved = replace(prisms, x=prisms.x - pose[0, 3], y=prisms.y - pose[1, 3])
    expected = reference(rays, [0.0, 0.0, pose[2, 3]], moved)
    # The reference solves for each ray anew: at an edge it may just pass by.
    assert (np.abs(expected[:, 0] - level) < 1e-6 * level).mean() > 0.999
    assert Counter(sweep.labels[sweep.valid].tolist()).keys() == {
        int(PointClass.ROAD),
        int(PointClass.OTHER),
    }


class Rays(Fan):
    """Single rays for the reference."""

    headings = property(lambda self: self.first)


@pytest.mark.parametrize("name", ROSETTES)
def test_a_rosette_fills_its_field_of_view_and_nothing_else(name):
    things = PrismList()
    things.box((20.0, 0.0), (1.0, 200.0), 0.0, (-50.0, 80.0))
    field = SENSORS[name].rosette
    sweep, _ = shoot(things.freeze(), sensor=name)
    x, y, z = sweep.points[sweep.valid].T
    azimuth, elevation = np.rad2deg(np.arctan2(y, x)), np.rad2deg(np.arctan2(z, np.hypot(x, y)))
    ellipse = np.hypot(azimuth / field.width * 2, elevation / field.height * 2)
    assert ellipse.max() < 1.025  # the lasers beside each other widen it a little
    assert ellipse.max() > 0.99
    cells = np.stack([azimuth // (field.width / 20), elevation // (field.height / 20)], axis=1)
    # A sweep leaves gaps, which the next one fills; an ellipse covers pi / 4 of its box.
    assert 0.85 < len(np.unique(cells, axis=0)) / (400 * np.pi / 4) < 1.1


@pytest.mark.parametrize("name", ROSETTES)
def test_a_rosette_differs_from_scan_to_scan_and_not_from_call_to_call(name):
    nothing = PrismList().freeze()
    one, same, other = (shoot(nothing, sensor=name, seed=k)[0] for k in (0, 0, 1))
    np.testing.assert_array_equal(one.points, same.points)
    assert not np.array_equal(one.valid, other.valid)


def test_a_tilted_mounting_turns_the_points_and_is_told_to_the_reader(tmp_path):
    knobs = {"mount_roll_deg": 5.0, "mount_pitch_deg": -4.0, "query_mount_yaw_deg": 180.0}
    settings = with_knobs(replace(tiny("custom"), scan_spacing=50.0), knobs)
    scene = Scene(settings)
    np.testing.assert_allclose(scene.sensors[0].mount[2, :2], np.sin(np.deg2rad([4, 5])), atol=4e-4)
    np.testing.assert_allclose(scene.sensors[1].mount[2, 2], scene.sensors[0].mount[2, 2])
    assert scene.sensors[1].mount[0, 0] < -0.99
    root = simulate(settings, tmp_path / "sim")
    for session, name in enumerate(session_names(settings)):
        read = open_session("custom", root / "drive.yaml", name)
        pose = scene.drives[session].poses(scene.drives[session].scan_stamps[:1])[0]
        np.testing.assert_allclose(read.poses[0], pose @ scene.sensors[session].mount, atol=1e-5)


def driving(seconds):
    """10 m/s along x, while turning left by 0.8 rad/s."""
    turn = rotation_from_rpy(np.zeros(len(seconds)), np.zeros(len(seconds)), 0.8 * seconds)
    return pose_from(turn, np.stack([10.0 * seconds, 0 * seconds, 0 * seconds], axis=1))


@pytest.mark.parametrize("name", ["vlp16", "livox_avia"])
@pytest.mark.parametrize("upside_down", [False, True])
def test_points_of_a_moving_sensor_lie_on_the_wall_where_it_stood_at_their_time(name, upside_down):
    settings = replace(CLEAN, sensor=name, azimuths=720, upside_down=upside_down)
    sensor = sensor_of(settings, 0)
    things = PrismList()
    for yaw in np.arange(4) * np.pi / 2:
        things.box((25 * np.cos(yaw), 25 * np.sin(yaw)), (1.0, 60.0), yaw, (-0.5, 40.0))
    rng = np.random.default_rng(0)
    sweep = scan_in_motion(sensor, driving, 0.1, things.freeze(), flat_ground(), settings, rng)
    assert sweep.seconds.min() >= 0.0
    assert 0.9 * SWEEP < sweep.seconds.max() < SWEEP
    poses = driving(sweep.seconds) @ sensor.mount
    for seen, worst in ((poses, 0.12), (np.broadcast_to(poses[0], poses.shape), np.inf)):
        world = np.einsum("cij,cbj->cbi", seen[:, :3, :3], sweep.points) + seen[:, None, :3, 3]
        world = world[sweep.valid]
        off = np.minimum(np.abs(world[:, 2]), np.abs(np.abs(world[:, :2]).max(axis=1) - 24.5))
        assert off.max() < worst
    assert off.max() > 0.3  # read as if all had been measured at once


def test_a_spinning_sensor_fires_clockwise_seen_from_its_own_top():
    turns = []
    for upside_down in (False, True):
        settings = replace(CLEAN, sensor="vlp16", upside_down=upside_down)
        rng = np.random.default_rng(0)
        sweep = scan_in_motion(
            *(sensor_of(settings, 0), driving, 0.1, PrismList().freeze(), flat_ground()),
            *(settings, rng),
        )
        order = np.argsort(sweep.seconds)
        beam = int(np.argmax(sweep.valid.sum(axis=0)))
        x, y, _ = sweep.points[order, beam].T
        turns.append(np.nanmedian(np.diff(np.unwrap(np.arctan2(y, x)))))
    assert turns[0] < 0 < turns[1]


def test_motion_is_that_of_the_drive_and_its_times_are_in_the_file(tmp_path):
    settings = replace(tiny("custom"), scan_spacing=50.0, motion_distortion=True, range_noise=0.0)
    scene = Scene(settings)
    root = simulate(settings, tmp_path / "sim")
    files = sorted((root / "map" / "scans").iterdir())
    sweep, drive = scene.sweep(0, 2), scene.drives[0]
    header, body = files[2].read_bytes().split(b"DATA binary\n")
    assert b"FIELDS x y z intensity time\n" in header
    rows = np.frombuffer(body, "<f4").reshape(-1, 5)
    np.testing.assert_allclose(rows[:, :3], sweep.points[sweep.valid], atol=1e-5)
    poses = drive.poses(drive.scan_stamps[2] + np.round(rows[:, 4] * 1e6).astype(np.int64))
    world = np.einsum("nij,nj->ni", (poses @ scene.sensors[0].mount)[:, :3, :3], rows[:, :3])
    world += (poses @ scene.sensors[0].mount)[:, :3, 3]
    height = world[:, 2] - scene.world.ground.height(world[:, 0], world[:, 1])
    ground = np.isin(sweep.labels[sweep.valid], GROUNDS)
    assert np.abs(height[ground & (np.hypot(*rows[:, :2].T) < 20)]).max() < 0.1
    read = open_session("custom", root / "drive.yaml", "map")
    np.testing.assert_allclose(read.read(files[2]), rows[:, :3])


def test_rain_returns_near_drops_and_takes_far_returns():
    things = PrismList()
    for yaw in np.arange(4) * np.pi / 2:
        things.box((60 * np.cos(yaw), 60 * np.sin(yaw)), (1.0, 130.0), yaw, (-0.5, 90.0))
    dry, _ = shoot(things.freeze(), sensor="os1_64", azimuths=512)
    share = []
    for rate in (5.0, 30.0):
        wet, _ = shoot(things.freeze(), sensor="os1_64", azimuths=512, rain_mm_per_hour=rate)
        reach = {k: np.linalg.norm(s.points, axis=-1) for k, s in (("dry", dry), ("wet", wet))}
        drop = wet.valid & ~(np.abs(reach["wet"] - reach["dry"]) < 1e-6)
        assert (reach["wet"][drop & dry.valid] < reach["dry"][drop & dry.valid]).all()
        assert np.median(reach["wet"][drop]) < 10.0
        same = wet.valid & ~drop
        np.testing.assert_allclose(wet.points[same], dry.points[same])
        # A ray comes back from a surface at distance d through 2 d of rain (Beer-Lambert).
        kept = np.exp(-2 * extinction(rate) * reach["dry"][dry.valid]).mean()
        assert same.sum() / dry.valid.sum() == pytest.approx(kept, abs=0.02)
        share.append(drop.mean())
    assert 0.001 < share[0] < share[1] < 0.05


def test_rain_weakens_by_the_recommendation():
    # 5 dB/km at 10 mm/h (ITU-R P.1817), i.e. 1.16 per kilometre.
    assert extinction(10.0) == pytest.approx(1.16e-3, rel=0.01)


@pytest.mark.parametrize("name", ["nclt", "mulran", "custom"])
def test_labels_are_beside_the_scans_in_the_order_of_their_points(name, tmp_path):
    settings = replace(tiny(name), scan_spacing=50.0, labels=True)
    scene = Scene(settings)
    root = simulate(settings, tmp_path / "sim")
    for session, drive in enumerate(session_names(settings)):
        read = open_session(name, root / "drive.yaml" if name == "custom" else root, drive)
        sweep = scene.sweep(session, 1)
        labels = np.fromfile(label_path(read.files[1]), "<u4")
        points = read.read(read.files[1])
        points = points[np.isfinite(points[:, 0])] if len(points) != len(labels) else points
        assert len(labels) == len(points)
        assert set(labels.tolist()) <= set(PointClass)
        counts = Counter(sweep.labels[sweep.valid].tolist())
        found = Counter(labels[labels > 0].tolist())
        assert found == counts
        pose = scene.drives[session].poses(read_stamp(scene, session, 1))[0]
        sensor = scene.sensors[session]
        body = pose if name == "nclt" else pose @ sensor.mount
        world = points @ body[:3, :3].T + body[:3, 3]
        height = world[:, 2] - scene.world.ground.height(world[:, 0], world[:, 1])
        assert np.median(np.abs(height[np.isin(labels, GROUNDS)])) < 0.05
        assert np.median(height[labels == PointClass.BUILDING]) > 0.8


def read_stamp(scene, session, index):
    return scene.drives[session].scan_stamps[index : index + 1]


def test_lost_labels_are_written_again(tmp_path):
    settings = replace(tiny("nclt"), scan_spacing=50.0, labels=True)
    root = simulate(settings, tmp_path / "sim")
    labels = sorted(root.rglob("*.label"))
    assert len(labels) == len(list(root.rglob("*.bin")))
    before = labels[0].read_bytes()
    labels[0].unlink()
    simulate(settings, root)
    assert labels[0].read_bytes() == before


def test_labels_do_not_change_the_scans(tmp_path):
    few = replace(tiny("mulran"), scan_spacing=50.0)
    with_labels = simulate(replace(few, labels=True), tmp_path / "with")
    without = simulate(few, tmp_path / "without")
    for file in sorted(without.rglob("*.bin")):
        assert (with_labels / file.relative_to(without)).read_bytes() == file.read_bytes()


def test_a_data_set_from_before_a_setting_is_still_known(tmp_path):
    settings = replace(tiny("mulran"), scan_spacing=50.0)
    root = simulate(settings, tmp_path / "sim")
    text = (root / NAME).read_text()
    lines = [line for line in text.splitlines() if "rain_mm" not in line and "upside" not in line]
    (root / NAME).write_text("\n".join(lines))
    calls = []
    simulate(settings, root, progress=lambda *counts: calls.append(counts))
    assert not calls


@pytest.mark.parametrize(
    ("base", "knobs", "complaint"),
    [
        (nclt, {"mount_roll_deg": 2.0}, r"mount_roll_deg: 2\.0, expected 0\.0 in the layout nclt"),
        (nclt, {"query_mount_yaw_deg": 2.0}, r"query_mount_yaw_deg: 2\.0, expected None"),
        (custom, {"mount_pitch_deg": 40.0}, r"mount_pitch_deg: 40\.0, expected a number from -20"),
        (custom, {"query_mount_roll_deg": -30.0}, r"query_mount_roll_deg: -30\.0"),
        (custom, {"rain_mm_per_hour": -1.0}, r"rain_mm_per_hour: -1\.0, expected a number"),
        (custom, {"labels": 1.0}, r"labels: 1\.0, expected True or False"),
    ],
)
def test_effects_that_cannot_be_are_named(base, knobs, complaint):
    with pytest.raises(ConfigError, match=complaint):
        with_knobs(base(), knobs)
