"""Kinds of ground: against loops over streets and parked cars, and in the labels of scans."""

from dataclasses import replace

import numpy as np
import pytest

from deepring.simulation.ground_cover import GroundCover
from deepring.simulation.presets import tiny
from deepring.simulation.scene import Scene
from deepring.simulation.shapes import DATABASE, GROUNDS, QUERY, PointClass, PrismList
from deepring.simulation.streets import clearance
from deepring.simulation.world import build_world


def from_street(point, start, end):
    way = end - start
    share = min(max((point - start) @ way / (way @ way), 0.0), 1.0)
    return np.hypot(*(point - start - share * way))


def by_loop(point, world, kerb, sidewalk):
    ends = [(world.streets.crossings[a], world.streets.crossings[b]) for a, b in world.streets.all]
    away = min(from_street(point, *pair) for pair in ends)
    if away < kerb:
        return PointClass.ROAD
    cars = world.prisms[np.flatnonzero(world.prisms.kind == PointClass.PARKED_CAR)]
    for k in range(len(cars)):
        dx, dy = point[0] - cars.x[k], point[1] - cars.y[k]
        c, s = np.cos(cars.yaw[k]), np.sin(cars.yaw[k])
        along, across = abs(c * dx + s * dy), abs(c * dy - s * dx)
        if along < cars.half_length[k] + 0.6 and across < cars.half_width[k] + 0.35:
            return PointClass.PARKING
    return PointClass.SIDEWALK if away < kerb + sidewalk else PointClass.TERRAIN


@pytest.mark.parametrize(("kind", "sidewalk"), [("campus", 3.0), ("terraces", 3.0), ("trees", 0.0)])
def test_kinds_of_ground_against_a_loop(kind, sidewalk):
    settings = tiny("custom", world=kind)
    world = build_world(settings)
    rng = np.random.default_rng(0)
    ends = rng.choice(world.streets.all, 600)
    share = rng.random((600, 1))
    points = np.vstack([
        share * world.streets.crossings[ends[:, 0]]
        + (1 - share) * world.streets.crossings[ends[:, 1]]
        + rng.uniform(-14, 14, (600, 2))
    ])  # fmt: skip
    found = world.cover.kinds(points)
    expected = [by_loop(point, world, settings.corridor, sidewalk) for point in points]
    assert found.tolist() == expected
    assert set(expected) == set(GROUNDS) - ({PointClass.SIDEWALK} if not sidewalk else set())


def test_streets_that_are_far_from_all_points_are_left_out_and_change_nothing():
    streets = build_world(tiny("custom")).streets
    points = streets.crossings[0] + np.random.default_rng(0).uniform(-15, 15, (200, 2))
    whole, near = clearance(points, streets), clearance(points, streets, within=6.0)
    assert np.array_equal(np.minimum(near, 6.0), np.minimum(whole, 6.0))
    assert np.isinf(clearance(points + 1000.0, streets, within=6.0)).all()
    assert clearance(points[:0], streets).shape == (0,)


@pytest.mark.parametrize("motion", [False, True])
def test_labels_of_a_scan_are_those_of_the_ground_where_the_points_lie(motion):
    settings = replace(
        tiny("custom", world="terraces"), range_noise=0.0, motion_distortion=motion, azimuths=180
    )
    scene = Scene(settings)
    sweep, drive = scene.sweep(1, 9), scene.drives[1]
    moments = np.zeros(len(sweep.points)) if sweep.seconds is None else sweep.seconds
    stamps = drive.scan_stamps[9] + np.round(moments * 1e6).astype(np.int64)
    poses = drive.poses(stamps) @ scene.sensors[1].mount
    world = np.einsum("nij,nbj->nbi", poses[:, :3, :3], sweep.points) + poses[:, None, :3, 3]
    ground = np.isin(sweep.labels, GROUNDS)
    expected = scene.world.cover.kinds(world[ground][:, :2])
    agree = sweep.labels[ground] == expected
    # The sensor stands still during a twentieth of a sweep in motion: points move by centimetres.
    assert agree.mean() > 0.98 if motion else agree.all()
    assert set(np.unique(expected)) == set(GROUNDS)


def test_a_slot_is_parking_in_both_sessions_whichever_has_the_car():
    things = PrismList()
    for x, session in ((0.0, DATABASE), (20.0, QUERY)):
        things.box((x, 9.0), (4.4, 1.8), 0.0, (-0.5, 1.5), sessions=session)
    streets = build_world(tiny("custom")).streets
    far = replace(streets, crossings=streets.crossings + 1000.0)
    cover = GroundCover(far, things.freeze(), 4.0, 3.0)
    points = np.array([[2.7, 9.0], [22.7, 10.2], [2.9, 9.0], [0.0, 10.3]])
    wanted = [PointClass.PARKING] * 2 + [PointClass.TERRAIN] * 2
    assert cover.kinds(points).tolist() == wanted
    empty = GroundCover(far, things.freeze()[:0], 4.0, 3.0)
    assert empty.kinds(points).tolist() == [PointClass.TERRAIN] * 4
    assert empty.kinds(points[:0]).tolist() == []
