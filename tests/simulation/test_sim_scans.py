"""Scans: frames, tilt, noise, the blind sector, movers; repeatable one by one."""

from dataclasses import replace

import numpy as np
import pytest

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.simulation.mounting import hdl32e_upside_down, os1_64
from deepring.simulation.presets import nclt, tiny
from deepring.simulation.scene import Scene
from deepring.simulation.sensors import scan
from deepring.simulation.shapes import PrismList
from deepring.simulation.world import moving_objects
from helpers.scenes import flat_ground

CLEAN = replace(nclt(), range_noise=0.0, dropout_near=0.0, dropout_far=0.0, azimuths=180)


def shoot(sensor, pose, things, settings=CLEAN):
    rng = np.random.default_rng(0)
    return scan(sensor, pose, 0.1, things.freeze(), flat_ground(), settings, rng)


def test_points_lie_on_the_surfaces_whatever_the_tilt():
    sensor = hdl32e_upside_down()
    pose = pose_from(rotation_from_rpy(0.06, -0.05, 2.1), [5.0, -3.0, -0.15])
    things = PrismList()
    things.box((30.0, 0.0), (1.0, 60.0), 0.0, (-0.5, 12.0))
    sweep = shoot(sensor, pose, things)
    sensor_pose = pose @ sensor.mount
    world = sweep.points[sweep.valid] @ sensor_pose[:3, :3].T + sensor_pose[:3, 3]
    on_ground, on_wall = np.abs(world[:, 2]) < 1e-6, np.abs(world[:, 0] - 29.5) < 1e-6
    assert (on_ground | on_wall).all()
    assert on_ground.sum() > 100
    assert on_wall.sum() > 100


def test_beam_elevations_are_exact_on_a_tilted_platform():
    sensor = hdl32e_upside_down()
    pose = pose_from(rotation_from_rpy(0.07, 0.05, -1.0), [0.0, 0.0, -0.15])
    things = PrismList()
    for yaw in np.arange(4) * np.pi / 2:
        centre = (25.0 * np.cos(yaw), 25.0 * np.sin(yaw))
        things.box(centre, (1.0, 60.0), yaw, (-0.5, 30.0))
    sweep = shoot(sensor, pose, things)
    reach = np.hypot(sweep.points[..., 0], sweep.points[..., 1])
    elevation = np.arctan2(sweep.points[..., 2], reach)
    wanted = np.broadcast_to(sensor.elevations, elevation.shape)
    np.testing.assert_allclose(elevation[sweep.valid], wanted[sweep.valid], atol=1e-9)


def test_a_wall_on_the_left_has_positive_y():
    things = PrismList()
    things.box((0.0, 12.0), (10.0, 1.0), 0.0, (-0.5, 6.0))
    pose = pose_from(np.eye(3), [0.0, 0.0, -0.15])
    sweep = shoot(hdl32e_upside_down(), pose, things)
    wall = sweep.points[sweep.valid & (sweep.points[..., 2] > 0.5)]
    assert len(wall) > 20
    np.testing.assert_allclose(wall[:, 1], 11.5 - 0.004, atol=1e-9)


def test_the_ground_is_where_nclt_has_it():
    sensor = hdl32e_upside_down()
    pose = pose_from(np.eye(3), [0.0, 0.0, sensor.body_height])
    sweep = shoot(sensor, pose, PrismList())
    body = sweep.points[sweep.valid] + sensor.mount[:3, 3]
    np.testing.assert_allclose(body[:, 2], 0.15, atol=1e-9)
    assert sweep.valid.any(axis=0).sum() < 10  # most beams look up


def test_range_noise_and_dropout_follow_their_settings():
    settings = replace(CLEAN, range_noise=0.05, dropout_near=0.1, dropout_far=0.1, azimuths=2000)
    pose = pose_from(np.eye(3), [0.0, 0.0, -0.15])
    clean = shoot(hdl32e_upside_down(), pose, PrismList(), replace(CLEAN, azimuths=2000))
    noisy = shoot(hdl32e_upside_down(), pose, PrismList(), settings)
    assert noisy.valid.sum() / clean.valid.sum() == pytest.approx(0.9, abs=0.02)
    both = noisy.valid & clean.valid
    error = np.linalg.norm(noisy.points[both], axis=1) - np.linalg.norm(clean.points[both], axis=1)
    assert error.std() == pytest.approx(0.05, rel=0.1)


def test_the_blind_sector_is_centred_on_plus_x_of_the_lidar():
    settings = replace(CLEAN, layout="mulran", blind_width_deg=70.0, azimuths=720)
    pose = pose_from(np.eye(3), [0.0, 0.0, 0.0])
    sweep = shoot(os1_64(), pose, PrismList(), settings)
    azimuth = np.rad2deg(np.arctan2(sweep.points[..., 1], sweep.points[..., 0]))[sweep.valid]
    assert np.abs(azimuth).min() == pytest.approx(35.0, abs=0.6)
    assert np.abs(azimuth).max() > 179.0


def test_movers_are_counted_placed_and_drawn_by_the_dice():
    settings = replace(CLEAN, movers=10.0, mover_vehicle_share=0.3)
    pose = pose_from(np.eye(3), [100.0, 50.0, 0.0])
    counts = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        movers = moving_objects(pose, flat_ground(), settings, rng)
        counts.append(len(movers))
        assert (np.abs(movers.y - 50.0) >= 3.5).all()
    assert np.mean(counts) == pytest.approx(10.0, abs=0.8)


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_a_scan_does_not_depend_on_the_scans_before_it(name):
    one, other = Scene(tiny(name)), Scene(tiny(name))
    one.sweep(0, 0)
    one.sweep(1, 3)
    a, b = one.sweep(0, 5), other.sweep(0, 5)
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.reflectance, b.reflectance)
    assert a.valid.mean() > 0.2
    unlike = Scene(tiny(name, seed=1)).sweep(0, 5)
    assert not np.array_equal(a.valid, unlike.valid)
