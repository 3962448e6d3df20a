"""Scenes of maps, located scans and drives: where things are in the world."""

import numpy as np
import pytest

from deepring.data.clouds.voxels import first_rows
from deepring.localization.place_points import thinned_points
from deepring.localization.scan_points import scan_points
from deepring.reports.drive_scene import drive_scene
from deepring.reports.map_scene import locations_scene, map_scene
from deepring.reports.scene import GREEN, ORANGE, Lines, Points
from helpers.drive_results import N, result
from helpers.scenes import scattered
from helpers.small_maps import GROUND_Z, PLACES, located, location, seen_at, small_map

#: From the walls' frame, on the ground, to the world of the places.
LIFT = np.array([0.0, 0.0, 10.0 + GROUND_Z])


def shapes_of(scene, path):
    return [shape for shape in scene.shapes if shape.path == path]


def distances(points, others):
    return np.linalg.norm(points[:, None] - others[None], axis=-1).min(axis=1)


@pytest.mark.parametrize("points", [True, False])
def test_what_places_show_lies_in_the_world(points):
    place_map = small_map(points=points)
    path = PLACES * [1, 1, 0]
    scene = map_scene(place_map, [path])
    (places,) = shapes_of(scene, "map/places")
    np.testing.assert_array_equal(places.positions, PLACES * [1, 1, 0] + [0, 0, 10])
    assert list(places.labels) == ["a.npy", "b.npy", "c.npy"]
    (shown,) = shapes_of(scene, "map/points")
    world = scattered(3) + LIFT
    flat = distances(shown.positions[:, :2], world[:, :2])
    assert np.quantile(flat, 0.99) < 1.2  # a cell is 1.17 m wide
    if points:
        assert distances(shown.positions, world).max() < 0.5  # one point per 0.5 m
        heights = shown.positions[:, 2] - (10.0 + GROUND_Z)
        lightest = shown.colour.astype(int).sum(axis=1)
        assert lightest[heights.argmax()] > lightest[heights.argmin()]
    else:
        np.testing.assert_allclose(shown.positions[:, 2], 10.0 + GROUND_Z)
    assert isinstance(shapes_of(scene, "map/path")[0], Lines)


def test_places_far_from_the_origin_have_one_near_by():
    scene = map_scene(small_map(offset=(345_000.0, 4_037_000.0)))
    np.testing.assert_array_equal(scene.origin, [345_000.0, 4_036_000.0, 0.0])
    np.testing.assert_array_equal(map_scene(small_map()).origin, np.zeros(3))


def test_located_scans_are_points_in_the_world_coloured_by_trust():
    place_map = small_map()
    at = (10.0, 1.0, 2.5)
    points = thinned_points(scan_points("scan", seen_at(*at)))
    scans = [
        located(place_map, "s", location(1, *at), (10.0, 2.0, 2.5), points),
        located(place_map, "t", location(doubt="ratio"), None, points),
    ]
    scene = locations_scene(place_map, scans)
    first, second = shapes_of(scene, "scan/points")
    world = scattered(3) + LIFT
    assert distances(first.positions, world).max() < 0.5
    assert distances(second.positions, world).mean() > 1.0  # it is not there
    assert (first.colour, second.colour) == (GREEN, ORANGE)
    assert (first.step, second.step) == (0, 1)
    assert [list(p.labels) for p in shapes_of(scene, "scan/position")] == [
        ["s: trusted"],
        ["t: ratio"],
    ]
    (trusted,), (doubtful,) = (shapes_of(scene, f"located/{w}") for w in ("trusted", "doubtful"))
    np.testing.assert_allclose(trusted.positions, [[10, 1, 10]])
    np.testing.assert_allclose(doubtful.positions, [[0, 0, 10]])
    (errors,) = shapes_of(scene, "located/to_the_true_position")
    np.testing.assert_allclose(errors.strips, [[[10, 1, 10], [10, 2, 10]]])


def test_one_point_stays_of_each_voxel():
    points = np.array([[-0.1, 0, 0], [0.1, 0, 0], [0.4, 0.4, 0.4], [0.6, 0, 0]])
    assert first_rows(points, 0.5).tolist() == [0, 1, 3]
    assert first_rows(points[:0], 0.5).tolist() == []


def test_a_drive_has_its_trajectories_and_loops():
    scene = drive_scene(result())
    for name in ("odometry", "optimized"):
        (trajectory,) = shapes_of(scene, f"{name}/trajectory")
        assert [len(strip) for strip in trajectory.strips] == [15, N - 15]  # a break
        (loops,) = shapes_of(scene, f"{name}/loops")
        (strip,) = loops.strips
        np.testing.assert_allclose(strip[:, 0], [0.0, 24.0], atol=1e-9)
        (rejected,) = shapes_of(scene, f"{name}/loops_rejected")
        np.testing.assert_allclose(rejected.strips[0][:, 0], [3.0, 27.0], atol=1e-9)
    plain = drive_scene(result(optimized=False, truth=False))
    assert not shapes_of(plain, "true_poses")
    assert shapes_of(scene, "true_poses")
    assert all(isinstance(shape, Points | Lines) for shape in scene.shapes)
    assert all(" " not in shape.path for shape in scene.shapes)
