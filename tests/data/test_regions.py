"""Regions: geometry against loops and formulas, UTM precision, and every malformed spec named."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.data.regions import Disc, HalfPlane, Polygon, Region, parse_region
from deepring.errors import DeepringError

UTM = np.array([345090.0743, 4037591.323])
CORNERS = ((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0))  # an L


def positions(seed, n=400, size=15.0):
    return np.random.default_rng(seed).uniform(-size, size, (n, 2))


def crosses(vertices, x, y):
    """Even-odd rule, one edge at a time."""
    inside = False
    for (x0, y0), (x1, y1) in zip(vertices, (*vertices[1:], vertices[0]), strict=True):
        if (y0 > y) != (y1 > y) and x < (x1 - x0) * (y - y0) / (y1 - y0) + x0:
            inside = not inside
    return inside


@settings(max_examples=30, deadline=None)
@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(0.1, 12), st.integers(0, 99))
def test_disc_is_every_position_within_the_radius(x, y, radius, seed):
    points = positions(seed, 50)
    brute = [math.dist((x, y), p) <= radius for p in points]
    assert Disc((x, y), radius).contains(points).tolist() == brute


def test_disc_includes_its_border():
    inside = Disc((1.0, 2.0), 5.0).contains(np.array([[4.0, 6.0], [4.0, 6.0 + 1e-9]]))
    assert inside.tolist() == [True, False]


@settings(max_examples=30, deadline=None)
@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(0, 2 * math.pi), st.integers(0, 99))
def test_half_plane_lies_where_the_normal_points(x, y, heading, seed):
    points = positions(seed, 50)
    normal = (math.cos(heading), math.sin(heading))
    along = [(px - x) * normal[0] + (py - y) * normal[1] for px, py in points]
    inside = HalfPlane((x, y), normal).contains(points)
    assert inside.tolist() == [a >= 0 for a in along]
    # The usual misreading, the normal pointing outwards, is the other side.
    outward = HalfPlane((x, y), (-normal[0], -normal[1])).contains(points)
    assert not (inside & outward).any()


def test_half_plane_ignores_the_length_of_the_normal():
    points = positions(1)
    short, long = HalfPlane((1, 2), (3, -4)), HalfPlane((1, 2), (300, -400))
    assert np.array_equal(short.contains(points), long.contains(points))


def test_polygon_against_the_even_odd_rule():
    points = positions(2, 2000)
    brute = [crosses(CORNERS, x, y) for x, y in points]
    assert Polygon(CORNERS).contains(points).tolist() == brute
    assert 0 < sum(brute) < len(brute)
    # Its convex hull, or its bounding box, would take in the notch.
    assert not Polygon(CORNERS).contains(np.array([[8.0, 8.0]])).any()


lattice = st.tuples(st.integers(-4, 4), st.integers(-4, 4))


@settings(max_examples=200, deadline=None)
@given(st.lists(lattice, min_size=3, max_size=7))
def test_polygons_of_any_kind_against_exact_arithmetic_border_included(vertices):
    """Whole numbers leave no rounding: edges, vertices, spikes and crossings of all sorts."""
    exact = [(Fraction(x), Fraction(y)) for x, y in vertices]
    points = [(Fraction(x, 2), Fraction(y, 2)) for x in range(-9, 10) for y in range(-9, 10)]
    expected = [on_border(exact, *p) or crosses(exact, *p) for p in points]
    shape = Polygon(tuple((float(x), float(y)) for x, y in vertices))
    assert shape.contains(np.array(points, dtype=np.float64)).tolist() == expected


def on_border(vertices, x, y):
    """On an edge or a vertex, one edge at a time."""
    for (x0, y0), (x1, y1) in zip(vertices, (*vertices[1:], vertices[0]), strict=True):
        along = (x1 - x0) * (y - y0) == (y1 - y0) * (x - x0)
        if along and min(x0, x1) <= x <= max(x0, x1) and min(y0, y1) <= y <= max(y0, y1):
            return True
    return False


def test_edges_and_vertices_of_a_polygon_are_inside():
    border = [(0, 0), (10, 0), (10, 4), (4, 4), (5, 0), (10, 2), (7, 4), (4, 7), (0, 10), (0, 3)]
    assert Polygon(CORNERS).contains(np.array(border, dtype=float)).all()
    # On the lines that go on from the edges, but beyond their ends.
    beyond = [(11, 0), (-1, 0), (10, 5), (4, 11), (11, 4), (0, -1), (0, 11)]
    assert not Polygon(CORNERS).contains(np.array(beyond, dtype=float)).any()


def test_where_a_border_crosses_itself_twice_around_is_outside():
    angle = np.pi / 2 + np.arange(5) * 4 * np.pi / 5
    star = Polygon(tuple(zip(np.cos(angle), np.sin(angle), strict=True)))
    assert star.contains(np.array([[0.0, 0.9], [0.0, 0.0]])).tolist() == [True, False]


def test_polygon_ignores_orientation_start_and_a_repeated_last_vertex():
    points = positions(3)
    expected = Polygon(CORNERS).contains(points)
    for vertices in (CORNERS[::-1], CORNERS[2:] + CORNERS[:2], (*CORNERS, CORNERS[0])):
        assert np.array_equal(Polygon(vertices).contains(points), expected)


@pytest.mark.parametrize(
    "make",
    [
        lambda o: Disc(tuple(o), 5.0),
        lambda o: HalfPlane(tuple(o), (0.6, 0.8)),
        lambda o: Polygon(tuple(map(tuple, np.array(CORNERS) + o))),
    ],
    ids=["disc", "half_plane", "polygon"],
)
def test_coordinates_of_utm_size_keep_millimetres(make):
    # A millimetre on either side of the border, all along it.
    if isinstance(make(UTM), Polygon):
        middle = (np.array(CORNERS) + np.roll(CORNERS, -1, axis=0)) / 2
        edge = np.roll(CORNERS, -1, axis=0) - np.array(CORNERS)
        inwards = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.hypot(*edge.T)[:, None]
    elif isinstance(make(UTM), Disc):
        angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)
        inwards = -np.column_stack([np.cos(angle), np.sin(angle)])
        middle = -5.0 * inwards
    else:
        middle, inwards = np.arange(-20, 20)[:, None] * [-0.8, 0.6], np.array([0.6, 0.8])
    border = middle + UTM
    assert make(UTM).contains(border + 1e-3 * inwards).all()
    assert not make(UTM).contains(border - 1e-3 * inwards).any()
    # In float32 a step of UTM northing is a quarter of a metre.
    coarse = (border - 1e-3 * inwards).astype(np.float32).astype(np.float64)
    assert make(UTM).contains(coarse).any()


def test_region_is_the_union_of_inside_less_each_outside():
    a, b, hole = Disc((0, 0), 6), Disc((8, 0), 4), HalfPlane((0, 5), (0, 1))
    points = positions(4)
    expected = (a.contains(points) | b.contains(points)) & ~hole.contains(points)
    region = Region((a, b), (hole,))
    assert np.array_equal(region.contains(points), expected)
    assert not np.array_equal(expected, a.contains(points) & b.contains(points))  # no intersection


def test_no_inside_is_everywhere_but_the_outside():
    points = positions(5)
    assert parse_region(None, "k").contains(points).all()
    spec = [{"outside": {"disc": {"center": [0, 0], "radius": 6}}}]
    outside = parse_region(spec, "k").contains(points)
    assert np.array_equal(outside, ~Disc((0, 0), 6).contains(points))


def test_a_list_is_parsed_to_what_is_inside_and_what_is_outside():
    spec = [
        {"outside": {"disc": {"center": [1, 2], "radius": 0.5}}},
        {"disc": {"center": [50, -50], "radius": 220}},
        {"half_plane": {"point": [0, 1], "normal": [1, 0]}},
        {"polygon": [[0, 0], [1, 0], [1, 1]]},
    ]
    region = parse_region(spec, "data.regions.test")
    assert region.outside == (Disc((1.0, 2.0), 0.5),)
    assert region.inside == (
        Disc((50.0, -50.0), 220.0),
        HalfPlane((0.0, 1.0), (1.0, 0.0)),
        Polygon(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))),
    )


@pytest.mark.parametrize(
    "shape",
    [Disc((0, 0), 1), HalfPlane((0, 0), (1, 0)), Polygon(CORNERS)],
    ids=["disc", "half_plane", "polygon"],
)
def test_no_positions_give_an_empty_mask(shape):
    assert Region((shape,), (shape,)).contains(np.empty((0, 2))).shape == (0,)


@pytest.mark.parametrize(
    "bad",
    [
        "everywhere",
        7,
        [],
        {"disc": {"center": [0, 0], "radius": 1}},
        {"inside": []},
        [7],
        [{"outside": None}],
        [{"outside": [{"disc": {"center": [0, 0], "radius": 1}}]}],
        [{"outside": {"outside": {"disc": {"center": [0, 0], "radius": 1}}}}],
        [["disc"]],
        [{}],
        [{"circle": {"center": [0, 0], "radius": 1}}],
        [{"disc": {"center": [0, 0], "radius": 1}, "polygon": []}],
        [{"disc": {"center": [0, 0], "radius": -1}}],
        [{"disc": {"center": [0, 0], "radius": 0}}],
        [{"disc": {"center": [0, 0], "radius": math.inf}}],
        [{"disc": {"center": [0, 0], "radius": math.nan}}],
        [{"disc": {"center": [0, 0]}}],
        [{"disc": {"center": [0, 0], "radius": 1, "height": 3}}],
        [{"disc": {"center": [0, 0, 0], "radius": 1}}],
        [{"disc": {"center": [0, math.nan], "radius": 1}}],
        [{"disc": {"center": [10**400, 0], "radius": 1}}],
        [{"disc": {"center": "12", "radius": 1}}],
        [{"disc": None}],
        [{"half_plane": {"point": [0, 0], "normal": [0, 0]}}],
        [{"half_plane": {"point": [0, 0]}}],
        [{"polygon": [[0, 0], [1, 1]]}],
        [{"polygon": {"vertices": [[0, 0], [1, 1], [1, 0]]}}],
        [{"polygon": 3}],
    ],
    ids=repr,
)
def test_malformed_specs_are_named(bad):
    with pytest.raises(DeepringError, match=r"^data\.regions\.test"):
        parse_region(bad, "data.regions.test")


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4)
words = st.sampled_from(
    ["outside", "disc", "half_plane", "polygon", "center", "radius", "point", "normal"]
)
junk = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(words, inner, max_size=3),
    max_leaves=12,
)
pairs = st.lists(scalars | st.floats(-9, 9), min_size=1, max_size=3)
nearly = st.fixed_dictionaries({"center": pairs | junk, "radius": scalars}) | junk
shapes = st.dictionaries(words, nearly | st.lists(pairs, max_size=4), max_size=2) | junk


@settings(max_examples=400, deadline=None)
@given(junk | st.lists(shapes | st.fixed_dictionaries({"outside": shapes}), max_size=3))
def test_any_spec_is_a_region_or_one_error_that_names_the_key(spec):
    try:
        region = parse_region(spec, "data.regions.train")
    except DeepringError as error:
        assert str(error).startswith("data.regions.train")  # noqa: PT017
    else:
        assert region.contains(np.zeros((3, 2))).shape == (3,)


def test_the_place_of_a_malformed_shape_in_the_list_is_named():
    good = {"half_plane": {"point": [0, 1], "normal": [1, 0]}}
    with pytest.raises(DeepringError, match=r"^data\.regions\.train\[2\]: \{'disk'"):
        parse_region([good, {"outside": good}, {"disk": {}}], "data.regions.train")
