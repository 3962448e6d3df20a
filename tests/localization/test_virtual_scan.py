"""Virtual scans: what stands behind something is hidden, what stands before it is seen."""

import math

import numpy as np
import pytest
from scipy.spatial import KDTree

from deepring.errors import ConfigError
from deepring.localization.clouds.virtual_scan import VirtualSensor, virtual_scan
from helpers.clouds import ground, in_tiles, street, wall

SENSOR = VirtualSensor()
EYE = np.array([0.0, 0.0, 1.73])
GAP = 0.4


def scan(points, position=EYE, size=GAP, sensor=SENSOR, side=1000.0):
    seen = virtual_scan(in_tiles(np.asarray(points), side), position, size, sensor)
    return seen + np.asarray(position, dtype=np.float32)


def same(some, others, unmatched=0):
    """Whether all points but a few, on the border of a bin, are the same to a millimetre."""
    away = KDTree(some).query(others)[0], KDTree(others).query(some)[0]
    return all((distances > 1e-3).sum() <= unmatched for distances in away)


def brute_force(points, position, size, sensor):
    """The same by its definition, bin by bin, with angles of the bins' middles."""
    relative = np.asarray(points) - position
    flat = np.hypot(relative[:, 0], relative[:, 1])
    distance = np.linalg.norm(relative, axis=1)
    elevation = np.degrees(np.arctan2(relative[:, 2], flat))
    azimuth = np.degrees(np.arctan2(relative[:, 1], relative[:, 0])) % 360
    rows, columns = sensor.shape
    i = np.floor((elevation - sensor.fov[0]) / sensor.elevation_bin).astype(int)
    j = np.floor(((azimuth + 180) % 360) / sensor.azimuth_bin).astype(int) % columns
    valid = (flat <= sensor.reach) & (flat > 0) & (i >= 0) & (i < rows)
    depth = np.full((rows, columns), np.inf)
    for k in np.flatnonzero(valid):
        half = math.degrees(0.5 * size / distance[k])
        middle = sensor.fov[0] + (i[k] + 0.5) * sensor.elevation_bin
        narrow = max(math.cos(math.radians(middle)), 0.1)
        for a in range(rows):
            for b in range(-3, 4):
                near = abs(a - i[k]) * sensor.elevation_bin <= half and abs(a - i[k]) <= 3
                if near and abs(b) * sensor.azimuth_bin * narrow <= half:
                    column = (j[k] + b) % columns
                    depth[a, column] = min(depth[a, column], distance[k])
    kept = [k for k in np.flatnonzero(valid) if distance[k] <= depth[i[k], j[k]] + sensor.behind]
    return np.asarray(points)[kept]


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_definition(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-30, -30, -2], [30, 30, 12], (1500, 3))
    position = rng.uniform([-5, -5, 1], [5, 5, 3])
    sensor = VirtualSensor(fov=(-30, 30), reach=28)
    expected = brute_force(points, position, 0.5, sensor)
    assert same(scan(points, position, 0.5, sensor), expected)
    assert 0 < len(expected) < 0.9 * len(points)


def test_a_wall_hides_what_is_behind_it_and_not_what_is_before_it():
    near, far = wall([10, -8], [10, 8]), wall([20, -4], [20, 4])
    before, above = wall([5, -1], [5, 1], 0, 1), wall([20, -4], [20, 4], 11, 13)
    seen = scan(np.concatenate([near, far, before, above]), sensor=VirtualSensor(fov=(-25, 40)))
    x = np.round(seen[:, 0]).astype(int)
    assert (x == 10).sum() > 0.9 * len(near) - len(before)
    assert not ((x == 20) & (seen[:, 2] < 6)).any()
    assert (x == 5).sum() == len(before)
    assert ((x == 20) & (seen[:, 2] > 10)).sum() == len(above)
    alone = scan(far)
    assert len(alone) == len(far)


def test_gaps_of_the_cloud_are_no_gaps_of_a_wall():
    """Points 0.4 m apart at 5 m are 4.6° apart: in bins of 1° one sees between them."""
    near, far = wall([5, -8], [5, 8], step=0.4), wall([20, -6], [20, 6])
    points = np.concatenate([near, far])
    assert not (scan(points, size=0.5)[:, 0] > 15).any()
    assert (scan(points, size=0.01)[:, 0] > 15).sum() > 0.2 * len(far)


def test_turning_the_cloud_turns_what_is_seen():
    """By whole bins, to the last point; a turn the other way does not fit."""
    points = street(1)
    seen = scan(points)
    turn = math.radians(37.0)
    rotation = np.array(
        [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    turned = scan(points @ rotation.T)
    assert same(turned, seen @ rotation.T, 100)
    assert not same(turned, seen @ rotation, 10_000)


def test_a_higher_sensor_sees_over_a_low_wall():
    low, house = wall([8, -8], [8, 8], 0, 2.5), wall([25, -6], [25, 6], 0, 2.4)
    points = np.concatenate([low, house])
    assert not (scan(points)[:, 0] > 20).any()
    assert (scan(points, [0, 0, 4.73])[:, 0] > 20).any()


def test_reach_and_field_of_view_limit_what_is_seen():
    points = np.concatenate([ground(-80, 80, 0.5), wall([6, -3], [6, 3], 0, 30)])
    sensor = VirtualSensor(fov=(-10, 5), reach=50)
    relative = scan(points, sensor=sensor) - EYE
    flat = np.hypot(relative[:, 0], relative[:, 1])
    elevation = np.degrees(np.arctan2(relative[:, 2], flat))
    assert flat.max() <= 50
    # The last row of bins ends where whole bins do, less than a bin above the field of view.
    assert elevation.min() >= -10
    assert elevation.max() < 5 + sensor.elevation_bin


@pytest.mark.parametrize("side", [7.0, 40.0])
def test_tiles_give_the_scan_of_the_whole_cloud(side):
    points = street(2)
    whole = scan(points, position=[1.0, 2.0, 1.7])
    tiled = scan(points, position=[1.0, 2.0, 1.7], side=side)
    assert same(whole, tiled, 20)


def test_world_coordinates_change_nothing():
    points = street(3)
    far = np.array([345678.0, 4037654.0, 120.0])
    moved = virtual_scan(in_tiles(points + far, 40.0), EYE + far, GAP, SENSOR)
    here = virtual_scan(in_tiles(points, 40.0), EYE, GAP, SENSOR)
    assert abs(len(moved) - len(here)) < 0.01 * len(here)
    np.testing.assert_allclose(moved.mean(axis=0), here.mean(axis=0), atol=0.05)


@pytest.mark.parametrize(
    "values", [{"height": 0.0}, {"fov": (5, -5)}, {"fov": (-100, 5)}, {"behind": -1}, {"reach": 0}]
)
def test_sensors_that_there_are_not(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        VirtualSensor(**values)
