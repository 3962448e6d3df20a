"""Streets, routes and drives: the same streets twice, in two parts that do not see each other."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deepring.core.rigid import yaw_of
from deepring.data.regions import parse_region
from deepring.simulation.drive import plan_drives
from deepring.simulation.presets import mulran, nclt, preset
from deepring.simulation.routes import database_route, opposed_share, query_route
from deepring.simulation.shapes import BOTH, DATABASE, QUERY
from deepring.simulation.split import REGIONS, UTM_ORIGIN
from deepring.simulation.streets import clearance, street_grid
from deepring.simulation.world import build_world


def streets_of(settings):
    return street_grid(settings, np.random.default_rng(settings.streets_seed))


def undirected(route):
    return {frozenset(step) for step in pairwise(route)}


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_routes_cover_every_street_of_their_part(name):
    streets = streets_of(preset(name))
    train, test = database_route(streets, np.random.default_rng(0))
    assert undirected(train) == {frozenset(s) for s in streets.train}
    assert undirected(test) == {frozenset(s) for s in streets.test}
    assert (train[-1], test[0]) == streets.link


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
def test_the_query_drives_the_same_streets_with_the_wanted_share_reversed(share):
    streets = streets_of(mulran(seed=3))
    for route in database_route(streets, np.random.default_rng(1)):
        query = query_route(route, share, np.random.default_rng(2))
        assert (query[0], query[-1]) == (route[0], route[-1])
        assert undirected(query) == undirected(route)
        assert query != route or share == 0.0
        # Streets that the database drives both ways can never count as reversed.
        most = opposed_share(route, route[::-1])
        assert opposed_share(route, query) == pytest.approx(min(share, most), abs=0.12)


def test_opposed_share_counts_only_directions_never_driven():
    assert opposed_share([0, 1, 2], [2, 1, 0]) == 1.0
    assert opposed_share([0, 1, 0], [1, 0, 1]) == 0.0
    assert opposed_share([0, 1, 2], [0, 1, 0]) == 0.5


@pytest.mark.parametrize("name", ["nclt", "mulran"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_both_sessions_revisit_the_same_places_in_both_regions(name, seed):
    settings = preset(name, seed)
    drives = plan_drives(build_world(settings), settings)
    positions = [d.poses(d.scan_stamps)[:, :2, 3] for d in drives]
    gap = np.linalg.norm(positions[1][:, None, :] - positions[0][None], axis=-1).min(axis=1)
    assert (gap < 2 * settings.lateral_offset + 2 * settings.lane_offset + 6.0).all()
    for p in positions:
        train, test = p[p[:, 0] <= 0], p[p[:, 0] >= 150]
        away = np.linalg.norm(train[::5, None] - test[None, ::5], axis=-1)
        assert away.min() >= 140.0
        metres = settings.scan_spacing
        assert 2000 < len(train) * metres < 5000
        assert 1500 < len(test) * metres < 4000


@pytest.mark.parametrize("seed", range(4))
def test_a_share_of_the_passes_is_reversed(seed):
    settings = replace(mulran(seed), reversed_share=0.3)
    drives = plan_drives(build_world(settings), settings)
    first, second = (d.poses(d.scan_stamps) for d in drives)
    opposed = 0
    for pose in second:
        near = np.linalg.norm(first[:, :2, 3] - pose[:2, 3], axis=1) < 15.0
        turn = np.cos(yaw_of(first[near]) - yaw_of(pose))
        opposed += bool(near.any()) and turn.max() < -0.5
    # The gap's street is not reversed, and corners count as neither.
    assert 0.1 < opposed / len(second) < 0.45


def test_regions_are_more_than_140_m_apart_and_named_in_both_frames():
    positions = np.array([[-50.0, 20.0], [5.0, 0.0], [145.0, 0.0], [200.0, -30.0]])
    for layout, origin in (("nclt", (0.0, 0.0)), ("mulran", UTM_ORIGIN)):
        train, test = (parse_region(REGIONS[layout][part], part) for part in ("train", "test"))
        assert train.contains(positions + origin).tolist() == [True, False, False, False]
        assert test.contains(positions + origin).tolist() == [False, False, False, True]


def test_headings_turn_no_faster_than_a_wheeled_robot():
    for settings in (nclt(), mulran()):
        for drive in plan_drives(build_world(settings), settings):
            turn = np.abs(np.diff(drive.path.yaw)) / np.diff(drive.path.driven)
            assert turn.max() < 1.2  # rad/m: a turn on less than a metre would be a jump
            assert np.median(turn) < 0.02


def test_the_sessions_do_not_share_their_sampling_phase():
    settings = nclt(seed=1)
    a, b = plan_drives(build_world(settings), settings)
    first = [(d.scan_stamps[0] - d.start) * 1e-6 * settings.speed for d in (a, b)]
    assert abs(first[0] - first[1]) > 0.01


def test_scan_stamps_fall_between_pose_rows_inside_their_time():
    settings = mulran(seed=2)
    for drive in plan_drives(build_world(settings), settings):
        assert (np.diff(drive.scan_stamps) > 0).all()
        assert not np.isin(drive.scan_stamps, drive.pose_stamps).any()
        assert drive.pose_stamps[3] < drive.scan_stamps[0]
        assert drive.pose_stamps[-1] > drive.scan_stamps[-1]
        assert np.median(np.diff(drive.pose_stamps)) == 10_000  # 100 Hz


def test_the_platform_sways_by_its_tilt():
    settings = replace(nclt(), tilt_deg=2.0)
    drive = plan_drives(build_world(settings), settings)[0]
    tilt = np.rad2deg(drive.poses(drive.pose_stamps)[:, :2, 2])
    np.testing.assert_allclose(tilt.std(axis=0), 2.0, rtol=0.15)


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_streets_stay_free_of_standing_objects(name):
    settings = preset(name, 1)
    world = build_world(settings)
    low = world.prisms[np.flatnonzero(world.prisms.grounded)]
    low = low[np.flatnonzero(low.z0 < world.ground.height(low.x, low.y))]
    centres = np.stack([low.x, low.y], axis=1)
    assert clearance(centres, world.streets).min() >= settings.corridor
    for drive in plan_drives(world, settings):
        points = np.stack([drive.path.x, drive.path.y], axis=1)
        assert clearance(points, world.streets).max() < settings.corridor + 2.0


def test_the_world_changes_between_the_sessions_as_told():
    settings = replace(nclt(seed=4), parking_share=0.0)
    prisms = build_world(settings).prisms
    crowns = prisms.sessions[prisms.depth > 0]
    assert (crowns != BOTH).mean() == pytest.approx(settings.trees_changed, abs=0.06)
    assert {DATABASE, QUERY} <= set(crowns.tolist())
    frozen = replace(settings, trees_changed=0.0, structures_changed=0.0)
    assert (build_world(frozen).prisms.sessions == BOTH).all()


def test_the_same_world_with_other_drives_and_cars():
    one, other = replace(nclt(1), world_seed=7), replace(nclt(2), world_seed=7)
    a, b = build_world(one), build_world(other)
    np.testing.assert_array_equal(a.streets.crossings, b.streets.crossings)
    crown_a, crown_b = a.prisms.depth > 0, b.prisms.depth > 0
    np.testing.assert_array_equal(a.prisms.x[crown_a], b.prisms.x[crown_b])
    assert len(a.prisms) != len(b.prisms)  # parked cars
    da, db = plan_drives(a, one)[0], plan_drives(b, other)[0]
    assert da.path.driven[-1] != db.path.driven[-1]
