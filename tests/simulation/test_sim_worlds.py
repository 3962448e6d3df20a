"""The kinds of worlds: what each one promises, from its streets up to the points of its scans."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from deepring.core.rigid import pose_from
from deepring.errors import ConfigError
from deepring.simulation.drive import plan_drives
from deepring.simulation.fan import Fan
from deepring.simulation.kinds.decks import place_deck
from deepring.simulation.kinds.houses import TERRACE, TOWN, place_row
from deepring.simulation.kinds.repeating import draw_pattern, repeat
from deepring.simulation.kinds.tunnels import place_tunnel
from deepring.simulation.measures import MEASURES, WorldKind
from deepring.simulation.presets import in_world, mulran, nclt, preset, tiny, with_knobs
from deepring.simulation.raycast import cast
from deepring.simulation.routes import database_route, query_route
from deepring.simulation.scene import Scene
from deepring.simulation.shapes import BOTH, DATABASE, GROUNDS, QUERY, PointClass, PrismList
from deepring.simulation.simulate import simulate
from deepring.simulation.streets import clearance, street_grid
from deepring.simulation.world import build_world
from deepring.simulation.yard import StreetSide, Yard
from helpers.cli import deepring
from helpers.scenes import flat_ground

KINDS = get_args(WorldKind)
NEW = ("terraces", "squares", "trees", "tunnels", "repeating")


def empty_yard(kind="terraces", **knobs):
    """A yard on flat ground, without anything in it."""
    settings = with_knobs(nclt(), {"world": kind, **knobs})
    return Yard(settings, flat_ground(), PrismList(), np.random.default_rng(3))


def straight(length=100.0):
    """The two sides of a street along x."""
    start, along, left = np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    return StreetSide(start, along, left, length), StreetSide(start, along, -left, length)


def of_kind(prisms, kind):
    return prisms[np.flatnonzero(prisms.kind == kind)]


def above_ground(scene, session, index):
    """Heights above the ground (n,), labels (n,) of a scan's returns."""
    sweep, drive = scene.sweep(session, index), scene.drives[session]
    pose = drive.poses(drive.scan_stamps[index : index + 1])[0] @ scene.sensors[session].mount
    points = sweep.points[sweep.valid] @ pose[:3, :3].T + pose[:3, 3]
    ground = scene.world.ground.height(points[:, 0], points[:, 1])
    return points[:, 2] - ground, sweep.labels[sweep.valid]


@pytest.fixture(scope="module")
def worlds():
    """A whole world of each new kind, with a few short streets."""
    few = {"train_columns": 3, "test_columns": 2, "rows": 2}
    settings = {kind: with_knobs(mulran(seed=4), {"world": kind, **few}) for kind in NEW}
    return {kind: (s, build_world(s)) for kind, s in settings.items()}


@pytest.mark.parametrize("kind", NEW)
def test_nothing_blocks_the_path(kind, worlds):
    settings, world = worlds[kind]
    prisms = world.prisms
    bottom = prisms.z0 - world.ground.height(prisms.x, prisms.y)
    clear = clearance(prisms.outline(), world.streets).min(axis=1) >= settings.corridor
    assert (bottom[~clear] > 1.9).all()  # crowns and ceilings
    opaque = prisms.depth == 0.0
    assert (bottom[~clear & opaque] > 2.4).all()  # a van passes below every ceiling
    for drive in plan_drives(world, settings):
        path = np.stack([drive.path.x, drive.path.y], axis=1)
        assert clearance(path, world.streets).max() < settings.corridor + 0.5
        for low in (prisms[np.flatnonzero(bottom <= 1.9)],):
            gaps = np.abs(path[::4, None] - np.stack([low.x, low.y], axis=1)[None])
            near = np.argwhere(np.hypot(gaps[..., 0], gaps[..., 1]) < low.reach)
            assert not _inside(low, path[::4], near).any()


def _inside(prisms, path, pairs):
    """Whether each (sample, prism) pair has the sample inside the prism's footprint."""
    sample, prism = pairs.T
    dx, dy = path[sample, 0] - prisms.x[prism], path[sample, 1] - prisms.y[prism]
    c, s = np.cos(prisms.yaw[prism]), np.sin(prisms.yaw[prism])
    u, v = c * dx + s * dy, c * dy - s * dx
    box = (np.abs(u) < prisms.half_length[prism]) & (np.abs(v) < prisms.half_width[prism])
    return np.where(prisms.round[prism], np.hypot(u, v) < prisms.half_length[prism], box)


@pytest.mark.parametrize("kind", NEW)
def test_every_prism_has_a_class_that_its_kind_of_world_has(kind, worlds):
    _, world = worlds[kind]
    found = {PointClass(value) for value in np.unique(world.prisms.kind)}
    assert {PointClass.CROWN, PointClass.TRUNK, PointClass.POLE, PointClass.PARKED_CAR} <= found
    assert PointClass.NOTHING not in found
    assert not found & set(GROUNDS)
    assert (PointClass.BUILDING in found) == (kind != "trees")
    assert (PointClass.STRUCTURE in found) or kind != "tunnels"


def test_facades_of_a_row_are_continuous():
    for style in (TOWN, TERRACE):
        yard = empty_yard()
        side = straight()[0]
        place_row(side, (7.0, 81.0), 9.0, style, yard)
        houses = yard.prisms.freeze()
        # The walls of a house are as wide as its plot; bays and steps are narrower.
        walls = houses[np.flatnonzero(houses.half_width * 2 >= style.depth[0] - 1e-9)]
        order = np.argsort(walls.x)
        begin, end = (walls.x - walls.half_length)[order], (walls.x + walls.half_length)[order]
        assert begin[0] == pytest.approx(7.0)
        assert end[-1] == pytest.approx(81.0)
        np.testing.assert_allclose(begin[1:], end[:-1])
        front = (walls.y - walls.half_width)[order]
        assert np.abs(front - 9.0).max() <= style.shift
        assert len(walls) > 5


def test_a_beam_to_the_side_of_an_old_street_ends_on_a_facade():
    yard = empty_yard()
    for side in straight():
        place_row(side, (0.0, 100.0), 6.0, TOWN, yard)
    columns, origin = 360, np.array([50.0, 1.0, 1.7])
    fan = Fan(0.0, np.full((columns, 1), np.tan(np.deg2rad(3.0))))
    prisms = yard.prisms.freeze()
    _, hit = cast(fan, origin, prisms, flat_ground(), 100.0, np.random.default_rng(0))
    aside = np.abs(np.sin(fan.headings)) > np.sin(np.deg2rad(9.0))
    assert (hit[aside, 0] >= 0).all()
    assert (prisms.kind[hit[aside, 0]] == PointClass.BUILDING).all()


def test_the_ceiling_of_a_tunnel_closes_it():
    yard = empty_yard("tunnels")
    place_tunnel(straight(), (20.0, 80.0), yard)
    prisms = yard.prisms.freeze()
    ceiling = prisms[np.flatnonzero((prisms.z0 > 4.5) & (prisms.half_width > 4.0))]
    clear = ceiling.z0[0]
    assert 4.6 <= clear <= 6.2
    origin = np.array([50.0, 0.5, 1.7])
    slopes = np.tan(np.deg2rad(np.linspace(-20.0, 85.0, 50)))
    fan = Fan(0.1, np.tile(slopes, (90, 1)))
    distance, hit = cast(fan, origin, prisms, flat_ground(), 100.0, np.random.default_rng(0))
    top = origin[2] + np.where(hit >= 0, distance * fan.slopes, 0.0)
    assert top.max() <= clear + 1e-9  # no beam passes the ceiling or the top of a wall ...
    low = np.abs(np.sin(fan.headings)) < np.sin(np.deg2rad(16.0))
    assert (hit[~low] != -2).all()  # ... and none leaves but by the portals
    assert (hit[:, -1] >= 0).all()
    assert (prisms.kind[hit[:, -1]] == PointClass.STRUCTURE).all()
    on_ceiling = np.isclose(top, clear)
    assert on_ceiling.sum() > 500


def test_a_deck_has_pillars_a_low_ceiling_and_an_open_lane():
    yard, cars = empty_yard("tunnels"), empty_yard("tunnels", parking_share=0.9)
    place_deck(straight(), (20.0, 80.0), yard, cars)
    prisms, corridor = yard.prisms.freeze(), yard.settings.corridor
    structure = of_kind(prisms, PointClass.STRUCTURE)
    slim = np.maximum(structure.half_length, structure.half_width) < 0.31
    pillars = structure[np.flatnonzero(structure.grounded & slim)]
    assert len(pillars) > 20
    assert np.abs(pillars.y).min() - pillars.half_width.max() >= corridor
    origin = np.array([50.0, 0.0, 1.8])
    fan = Fan(0.0, np.full((60, 1), np.tan(np.deg2rad(60.0))))
    distance, hit = cast(fan, origin, prisms, flat_ground(), 100.0, np.random.default_rng(0))
    height = origin[2] + distance[:, 0] * fan.slopes[:, 0]
    assert (hit >= 0).all()
    assert (height >= 2.5).all()
    assert (height <= 3.1).all()
    parked = cars.prisms.freeze()
    assert len(parked) > 30
    assert set(parked.kind.tolist()) == {PointClass.PARKED_CAR}


@pytest.mark.parametrize("period", [16.0, 24.0])
def test_a_street_repeats_with_its_period(period):
    yard = empty_yard("repeating", period=period)
    pattern = draw_pattern(period, yard)
    repeat(straight(130.0)[0], 8.0, pattern, yard)
    prisms = yard.prisms.freeze()
    table = np.stack(
        [prisms.x, prisms.y, prisms.z1, prisms.half_length, prisms.half_width, prisms.kind], axis=1
    )
    count = len(pattern.parts) + 2
    periods, rest = divmod(len(table), count)
    assert rest == 0
    assert periods == int((130.0 - 2 * 9.0) // period)
    for one, other in pairwise(table.reshape(periods, count, -1)):
        np.testing.assert_allclose(
            other - one, np.eye(6)[0] * np.full((count, 1), period), atol=1e-9
        )
    for wrong in (period / 2, period + 1.0):  # no shorter period hides in it
        shifted = table[:count] + np.eye(6)[0] * wrong
        gaps = np.abs(shifted[:, None] - table[None]).max(axis=-1).min(axis=1)
        assert gaps.max() > 0.1
    assert (table[:, 0] >= 9.0).all()


def test_a_square_is_open_and_its_streets_have_facades(worlds):
    settings, world = worlds["squares"]
    buildings = of_kind(world.prisms, PointClass.BUILDING)
    away = [np.hypot(buildings.x - x, buildings.y - y).min() for x, y in world.streets.crossings]
    # At a plain crossing facades come close; at the others nothing is within a square's half side.
    assert np.mean(np.array(away) > 0.14 * settings.block * 0.8) > 0.3
    assert len(buildings) > 500


@pytest.mark.parametrize("kind", NEW)
@pytest.mark.parametrize("name", ["nclt", "mulran", "custom"])
def test_classes_of_points_agree_with_the_geometry(kind, name):
    settings = replace(tiny(name, seed=2, world=kind), movers=30.0, range_noise=0.0)
    scene = Scene(settings)
    scans = [above_ground(scene, session, i) for session in (0, 1) for i in (3, 17, 33, 50)]
    above, labels = (np.concatenate(parts) for parts in zip(*scans, strict=True))
    assert (labels != PointClass.NOTHING).all()
    assert np.abs(above[np.isin(labels, GROUNDS)]).max() < 0.15  # between samples of its profile
    for seen, highest in (
        (PointClass.PARKED_CAR, 2.9),
        (PointClass.MOVING_CAR, 3.5),
        (PointClass.MOVING_PERSON, 2.1),
        (PointClass.WALL, 2.8),
        (PointClass.TRUNK, 8.0),
    ):
        of_class = above[labels == seen]
        assert (of_class > -0.25).all()
        assert (of_class < highest).all()
    assert (labels == PointClass.BUILDING).any() == (kind != "trees")
    assert (labels == PointClass.STRUCTURE).sum() > 200 or kind != "tunnels"


def test_points_of_a_scan_under_a_ceiling_lie_on_it():
    """The rays of a whole scan, in a sensor's frame, with the noise of its range."""
    from deepring.simulation.mounting import hdl32e_upside_down
    from deepring.simulation.sensors import scan

    yard = empty_yard("tunnels")
    place_tunnel(straight(), (20.0, 80.0), yard)
    prisms = yard.prisms.freeze()
    clear = prisms.z0[prisms.z0 > 4.5].min()
    pose = pose_from(np.eye(3), [50.0, 0.0, -0.15])
    rng = np.random.default_rng(0)
    settings = replace(yard.settings, azimuths=180)
    sweep = scan(hdl32e_upside_down(), pose, 0.0, prisms, flat_ground(), settings, rng)
    z = sweep.points[..., 2] + 0.807
    seen = sweep.valid & (np.abs(z - clear) < 0.05)
    assert seen.sum() > 300
    assert (sweep.labels[seen] == PointClass.STRUCTURE).all()
    assert z[sweep.valid].max() < clear + 0.1


@pytest.mark.parametrize("kind", NEW)
def test_a_tiny_world_is_simulated_in_about_a_second(kind, tmp_path):
    root = simulate(replace(tiny("nclt", world=kind), scan_spacing=15.0), tmp_path / "sim")
    assert len(list(root.rglob("*.bin"))) > 30


def test_the_same_world_from_the_same_seed_for_both_layouts():
    for kind in NEW:
        one, other = (build_world(tiny(name, 5, world=kind)) for name in ("nclt", "mulran"))
        np.testing.assert_array_equal(one.prisms.x, other.prisms.x)
        np.testing.assert_array_equal(one.prisms.kind, other.prisms.kind)
        unlike = build_world(tiny("nclt", 6, world=kind))
        assert len(unlike.prisms) != len(one.prisms)


def test_a_world_brings_its_measures_and_other_knobs_go_before_them():
    assert in_world(nclt(), "campus") == nclt()
    assert in_world(mulran(), "city") == mulran()
    assert with_knobs(mulran(), {"world": "terraces"}).block == MEASURES["terraces"]["block"]
    assert with_knobs(mulran(), {"world": "terraces"}).building_share == 0.8  # no longer the city's
    assert with_knobs(nclt(), {"world": "terraces", "block": 77.0}).block == 77.0
    assert with_knobs(nclt(), {"block": 77.0, "world": "trees"}).block == 77.0
    assert with_knobs(mulran(), {"world": "trees"}).blind_width_deg == 70.0  # of the sensor
    with pytest.raises(ConfigError, match=r"world: 'moon', expected one of campus, city, terraces"):
        with_knobs(nclt(), {"world": "moon"})


def test_a_sensor_above_the_lowest_ceiling_is_refused():
    low = {"world": "tunnels", "sensor_height": 2.3}
    assert with_knobs(preset("custom"), low).sensor_height == 2.3
    for name in ("sensor_height", "query_sensor_height"):
        with pytest.raises(ConfigError, match=rf"{name}: 2\.4, expected at most 2\.3 in .*tunnels"):
            with_knobs(preset("custom"), {"world": "tunnels", name: 2.4})
        assert with_knobs(preset("custom"), {"world": "city", name: 2.4}).world == "city"


def test_the_command_line_takes_a_world(tmp_path):
    small = ("block=45", "train_columns=2", "test_columns=2", "rows=2", "crossing_jitter=3")
    coarse = ("azimuths=60", "scan_spacing=40")
    made = deepring("simulate", "nclt", "-o", "sim", "world=trees", *small, *coarse, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert '"world": "trees"' in (tmp_path / "sim" / "simulation.json").read_text()
    refused = deepring("simulate", "nclt", "-o", "other", "world=moon", cwd=tmp_path)
    assert refused.returncode != 0
    assert "world: 'moon', expected one of campus" in refused.stderr
    assert not (tmp_path / "other").exists()


def test_streets_that_bend_keep_their_crossings_and_are_all_driven():
    settings = replace(nclt(seed=2), street_bend=8.0)
    bent = street_grid(settings, np.random.default_rng(1))
    plain = street_grid(nclt(seed=2), np.random.default_rng(1))
    count = len(plain.crossings)
    np.testing.assert_array_equal(bent.crossings[:count], plain.crossings)
    assert bent.bends == frozenset(range(count, len(bent.crossings)))
    assert len(bent.train) == 2 * len(plain.train)
    assert bent.link == plain.link
    route, _ = database_route(bent, np.random.default_rng(0))
    steps = {frozenset(step) for step in pairwise(route)}
    assert steps == {frozenset(street) for street in bent.train}
    query = query_route(route, 0.5, np.random.default_rng(1))
    assert {frozenset(step) for step in pairwise(query)} == steps
    offsets = [
        np.linalg.norm(bent.crossings[node] - (plain.crossings[a] + plain.crossings[b]) / 2)
        for node, (a, b) in zip(sorted(bent.bends), (*plain.train, *plain.test), strict=True)
    ]
    assert max(offsets) <= 8.0
    assert max(offsets) > 4.0


@pytest.mark.parametrize("seed", range(3))
def test_a_grid_without_some_streets_stays_whole(seed):
    settings = replace(nclt(seed), streets_missing=0.25)
    few = street_grid(settings, np.random.default_rng(seed))
    all_of_them = street_grid(nclt(seed), np.random.default_rng(seed))
    np.testing.assert_array_equal(few.crossings, all_of_them.crossings)
    for part, whole in ((few.train, all_of_them.train), (few.test, all_of_them.test)):
        assert set(part) < set(whole)
        assert 0.75 * len(whole) <= len(part) <= 0.9 * len(whole)
        meets = Counter(crossing for street in (*part, few.link) for crossing in street)
        ends = {crossing for street in whole for crossing in street}
        assert min(meets[crossing] for crossing in ends) >= 2  # no dead end
    for route, part in zip(
        database_route(few, np.random.default_rng(0)), (few.train, few.test), strict=True
    ):
        assert {frozenset(step) for step in pairwise(route)} == {frozenset(s) for s in part}


@pytest.mark.parametrize("kind", ["campus", "terraces", "tunnels"])
def test_parked_cars_stay_or_change_between_the_sessions(kind):
    def sessions(changed):
        settings = with_knobs(nclt(seed=6), {"world": kind, "parking_changed": changed})
        cars = of_kind(build_world(settings).prisms, PointClass.PARKED_CAR)
        assert len(cars) > 100
        return np.bincount(cars.sessions, minlength=4)

    assert sessions(0.0)[[DATABASE, QUERY]].sum() == 0
    assert sessions(1.0)[BOTH] == 0
    one, other, both = sessions(0.5)[[DATABASE, QUERY, BOTH]]  # half of the slots are filled twice
    assert both / (one + other) == pytest.approx(0.5, abs=0.15)
    assert one / other == pytest.approx(1.0, abs=0.3)
