"""The column caster against closed forms and against a plain ray-by-ray reference."""

import numpy as np
import pytest

from deepring.simulation.fan import Fan
from deepring.simulation.ground import rolling_ground
from deepring.simulation.raycast import GROUND, NOTHING, cast
from deepring.simulation.shapes import PrismList
from helpers.raycasts import random_prisms, reference
from helpers.scenes import flat_ground

ORIGIN = np.array([0.0, 0.0, 1.8])


def fan(elevations_deg, columns=8, first=0.0) -> Fan:
    slopes = np.tan(np.deg2rad(np.asarray(elevations_deg, dtype=float)))
    return Fan(first, np.tile(slopes, (columns, 1)))


def shoot(some_fan, prisms, ground=None, origin=ORIGIN, max_range=100.0):
    ground = flat_ground() if ground is None else ground
    return cast(some_fan, origin, prisms, ground, max_range, np.random.default_rng(0))


def test_flat_ground_is_met_at_height_over_slope():
    some_fan = fan([-60.0, -10.0, -2.0, 0.0, 10.0])
    distance, hit = shoot(some_fan, PrismList().freeze())
    expected = ORIGIN[2] / np.tan(np.deg2rad([60.0, 10.0, 2.0]))
    np.testing.assert_allclose(distance[:, :3], np.tile(expected, (8, 1)), rtol=1e-9)
    assert (hit[:, :3] == GROUND).all()
    assert (hit[:, 3:] == NOTHING).all()
    assert np.isinf(distance[:, 3:]).all()


def test_nothing_is_seen_beyond_the_range():
    distance, hit = shoot(fan([-2.0]), PrismList().freeze(), max_range=50.0)
    assert np.isinf(distance).all()  # the ground is met at 51.5 m
    assert (hit == NOTHING).all()


def test_box_side_top_and_bottom():
    things = PrismList()
    things.box((10.0, 0.0), (4.0, 2.0), 0.0, (-0.5, 1.0))  # lower than the sensor
    things.box((0.0, 10.0), (4.0, 2.0), np.pi / 2, (3.0, 5.0), grounded=False)
    slopes = np.array([-0.2, -0.09, 0.14, 0.2])
    four = Fan(0.0, np.tile(slopes, (4, 1)))
    distance, hit = shoot(four, things.freeze())
    # Ahead: at 8 m the first beam is at 0.2 m (the side), the second at 1.08 m (the top, at z = 1).
    np.testing.assert_allclose(distance[0, :2], [8.0, 0.8 / 0.09])
    # To the left: the floating box from y = 8 to 12; the third beam enters through its bottom.
    np.testing.assert_allclose(distance[1, 2:], [1.2 / 0.14, 8.0])
    assert hit[0, 0] == hit[0, 1] == 0
    assert hit[1, 2] == hit[1, 3] == 1


def test_cylinder_range_off_centre():
    things = PrismList()
    things.cylinder((10.0, 0.6), 1.0, (-0.5, 6.0))
    distance, _ = shoot(fan([0.0], columns=360), things.freeze())
    assert distance[0, 0] == pytest.approx(10.0 - 0.8)


def test_many_prisms_match_the_reference():
    rng = np.random.default_rng(5)
    prisms = random_prisms(150, rng)
    some_fan = fan(np.linspace(-25.0, 30.0, 23), columns=301, first=0.3)
    distance, hit = shoot(some_fan, prisms)
    expected = reference(some_fan, ORIGIN, prisms)
    # The ground's profile is sampled, but flat ground is a straight line between samples.
    np.testing.assert_allclose(distance, expected, rtol=1e-6)
    assert (hit >= 0).mean() > 0.2  # the comparison is about prisms, too


def test_ceilings_above_the_sensor_match_the_reference():
    """Boxes that hang above the sensor, and beside it, and a slab below it, which it ignores."""
    rng = np.random.default_rng(6)
    things = PrismList()
    things.box((3.0, 1.0), (20.0, 9.0), 0.4, (4.0, 5.0), grounded=False)
    things.box((-2.0, 0.5), (8.0, 30.0), 1.1, (3.0, 3.4), grounded=False)
    things.box((0.0, 0.0), (500.0, 500.0), 0.0, (9.0, 9.5), grounded=False)
    for _ in range(30):
        x, y = rng.uniform(8, 40, 2) * rng.choice([-1, 1], 2)
        z0 = rng.uniform(2.2, 8.0)
        size = (rng.uniform(0.5, 12.0), rng.uniform(0.3, 8.0))
        things.box((x, y), size, rng.uniform(-4, 4), (z0, z0 + 1.0), grounded=False)
    some_fan = fan(np.linspace(-25.0, 80.0, 43), columns=301, first=0.3)
    distance, hit = shoot(some_fan, things.freeze())
    np.testing.assert_allclose(distance, reference(some_fan, ORIGIN, things.freeze()), rtol=1e-6)
    assert {0, 1, 2} <= set(hit.ravel().tolist())
    # A steep beam meets the lowest of the three above it.
    assert hit[0, -1] == 1
    assert distance[0, -1] == pytest.approx(1.2 / np.tan(np.deg2rad(80.0)))


@pytest.mark.parametrize("begin", [0, 3, 250, 290])
def test_a_sector_is_a_part_of_the_circle(begin):
    prisms = random_prisms(150, np.random.default_rng(6))
    slopes = np.tile(np.tan(np.deg2rad(np.linspace(-25.0, 30.0, 23))), (300, 1))
    whole = Fan(0.3, slopes)
    index = np.arange(begin, begin + 40) % 300
    sector = Fan(0.3 + begin * whole.step, slopes[index], 300)
    distance, hit = shoot(whole, prisms)
    part, part_hit = shoot(sector, prisms)
    np.testing.assert_allclose(part, distance[index], rtol=1e-9)
    np.testing.assert_array_equal(part_hit, hit[index])
    np.testing.assert_allclose(part, reference(sector, ORIGIN, prisms), rtol=1e-6)


def test_a_sector_of_rolling_ground_is_near_that_of_the_circle():
    ground = rolling_ground(2.0, np.random.default_rng(3))
    origin = np.array([0.0, 0.0, float(ground.height(np.zeros(1), np.zeros(1))[0]) + 1.0])
    slopes = np.tile(np.tan(np.deg2rad(np.linspace(-20.0, -3.0, 18))), (360, 1))
    whole, _ = shoot(Fan(0.0, slopes), PrismList().freeze(), ground, origin)
    part, _ = shoot(Fan(whole_step(359), slopes[:7], 360), PrismList().freeze(), ground, origin)
    np.testing.assert_allclose(part, whole[[359, 0, 1, 2, 3, 4, 5]], rtol=2e-3)


def whole_step(columns):
    return columns * 2 * np.pi / 360


def test_a_wall_hides_what_is_behind_and_not_what_is_taller():
    things = PrismList()
    things.box((20.0, 0.0), (1.0, 4.0), 0.0, (-0.5, 5.0))
    things.box((40.0, 0.0), (1.0, 4.0), 0.0, (-0.5, 5.0))
    things.box((60.0, 0.0), (1.0, 4.0), 0.0, (-0.5, 40.0))
    _, hit = shoot(fan(np.linspace(0.0, 30.0, 61), columns=4), things.freeze())
    assert set(hit[0]) == {0, 2}


def test_beams_stop_inside_a_crown_or_pass_through():
    things = PrismList()
    things.cylinder((20.0, 0.0), 3.0, (1.0, 9.0), depth=2.0)
    some_fan = fan([5.0] * 4, columns=4000)
    distance, hit = shoot(some_fan, things.freeze())
    centre = distance[0, hit[0] == 0]
    assert (distance[hit == 0] >= 17.0).all()
    assert (distance[hit == 0] <= 23.0).all()
    across = np.flatnonzero((hit >= 0).any(axis=1))
    passed = (hit[across] == NOTHING).mean()
    assert 0.05 < passed < 0.5
    assert len(centre) <= 4


def test_a_crest_hides_the_ground_behind_it():
    ground = rolling_ground(2.0, np.random.default_rng(3))
    origin = np.array([0.0, 0.0, float(ground.height(np.zeros(1), np.zeros(1))[0]) + 1.0])
    some_fan = fan(np.linspace(-12.0, 2.0, 57), columns=180)
    distance, hit = shoot(some_fan, PrismList().freeze(), ground, origin)
    met = hit == GROUND
    c, s = np.cos(some_fan.headings)[:, None], np.sin(some_fan.headings)[:, None]
    reach = np.where(met, distance, 0.0)
    z = origin[2] + reach * some_fan.slopes
    error = np.abs(z - ground.height(reach * c, reach * s))[met]
    assert np.median(error) < 0.02
    assert error.max() < 0.4  # grazing rays behind a crest
    assert (np.diff(np.where(met, distance, 1e3), axis=1) >= -1e-9).all()


def test_prisms_around_the_sensor_are_looked_through():
    things = PrismList()
    things.box((0.0, 0.0), (2.0, 2.0), 0.0, (-0.5, 5.0))
    distance, hit = shoot(fan([-5.0]), things.freeze())
    assert (hit == GROUND).all()
    assert np.isfinite(distance).all()
