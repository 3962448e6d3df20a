"""Queries on a page: which have pictures, and that scans are drawn where they lie."""

import base64
import io
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

from deepring.core.rigid import planar_pose, turn_points
from deepring.experiment.method_views import lie_of
from deepring.reports import svg
from deepring.reports.indexed_png import indexed_png
from deepring.reports.query_map import kinds_of
from deepring.reports.query_section import query_sections
from deepring.reports.query_view import Lie, PlaceView, QueryMap, QueryView, ScanView, chosen
from deepring.reports.scan_images import overlaid, scan_image
from helpers.html_pages import well_formed


@pytest.mark.parametrize("colours", [2, 5, 16])
def test_images_come_back_from_their_files(colours):
    rng = np.random.default_rng(0)
    image = rng.integers(0, colours, (7, 11))
    palette = [(k, 255 - k, 16 * k % 256) for k in range(colours)]
    read = imread(io.BytesIO(indexed_png(image, palette)))[..., :3]
    assert np.array_equal(np.round(read * 255), np.array(palette)[image])
    assert indexed_png(image, palette) == indexed_png(image.copy(), palette)


def test_the_first_colour_may_be_clear():
    read = imread(io.BytesIO(indexed_png(np.array([[0, 1]]), [(9, 9, 9), (1, 2, 3)], clear=True)))
    assert read[0, :, 3].tolist() == [0, 1]


def test_a_scan_is_drawn_with_x_upwards_and_y_to_the_left():
    image = np.zeros((4, 4), dtype=np.bool_)
    image[3, 0] = True  # ahead, to the right
    drawn = scan_image("a", image, 2.0, (1, 2, 3))
    png = base64.b64decode(re.search(r"base64,([^\"]*)", drawn)[1])
    assert np.argwhere(imread(io.BytesIO(png))[..., 3]).tolist() == [[0, 3]]


@given(
    st.floats(-3.1, 3.1), st.floats(-30, 30), st.floats(-30, 30), st.floats(-9, 9), st.floats(-9, 9)
)
@settings(derandomize=True, max_examples=10)
def test_an_overlay_carries_the_query_s_points_onto_the_place_s(yaw, x, y, px, py):
    pose = planar_pose(x, y, yaw)  # of the query's sensor in the place's frame
    lie = lie_of(pose)
    seen = np.array([px, py, 0.0])
    in_place = (pose @ np.append(seen, 1.0))[:2]
    turned = turn_points(np.append(in_place - [x, y], 0.0)[None], lie.turn)[0]
    assert turned == pytest.approx(seen, abs=1e-9)  # a turn of the points, not of the sensor
    where = re.search(r"translate\((\S+) (\S+)\) rotate\((\S+)\)", overlaid("p", "q", lie, 70, ""))
    across, down, degrees = map(float, where.groups())
    angle = math.radians(degrees)  # of SVG, clockwise where y points down
    sx, sy = -py, -px  # the query's point in its own drawing
    drawn = np.array(
        [
            across + sx * math.cos(angle) - sy * math.sin(angle),
            down + sx * math.sin(angle) + sy * math.cos(angle),
        ]
    )
    assert drawn == pytest.approx([-in_place[1], -in_place[0]], abs=0.02)


def test_half_of_the_pictures_are_the_surest_wrong_answers():
    scores = np.arange(20, dtype=np.float32)
    wrong = np.arange(20) % 2 == 1
    rows = chosen(scores, wrong, 6)
    assert [row for row in rows if wrong[row]] == [15, 17, 19]
    assert [row for row in rows if not wrong[row]] == [0, 8, 18]
    assert chosen(scores, wrong, 100) == [*range(20)]
    assert chosen(scores, wrong & False, 2) == [0, 19]
    assert chosen(scores, wrong | True, 2) == [18, 19]
    assert chosen(scores, wrong, 0) == []


def test_a_query_without_a_place_is_neither_right_nor_wrong():
    kinds = kinds_of(np.float32([1, 20, 20]), np.float32([1, 2, 15]), 10.0)
    assert kinds.tolist() == ["right", "wrong", "none"]


def region(**changes):
    image = np.eye(6, dtype=np.bool_)
    scan = [ScanView(number, image, None, np.float32([[1, 2]])) for number in range(9)]
    curve = np.float32([0.1, 0.5, 0.2, 0.1])
    place = PlaceView(scan[4], 30.0, 0.5, Lie(1.0, (2.0, 3.0)), Lie(0.9, None), curve=curve)
    near = PlaceView(scan[3], 2.0, 0.4, Lie(0.0, (0.0, 0.0)))
    fields = {
        "title": "town <b>test",
        "method": "DeepRING",
        "radius": 10.0,
        "axes": ("x", "y"),
        "places": np.array([[0.0, 0.0], [50.0, 5.0]]),
        "queries": np.array([[1.0, 0.0], [49.0, 5.0]]),
        "numbers": np.array([7, 8]),
        "found": np.array([1, 1]),
        "metres": np.float32([30, 1]),
        "nearest": np.float32([2, 1]),
        "scores": np.float32([0.5, 0.6]),
        "by_method": {"DeepRING": np.float32([30, 1]), "RING": np.float32([np.nan, 2])},
        "views": [QueryView(0, scan[7], place, near), QueryView(1, scan[8], near, None)],
    }
    return QueryMap(**fields | changes)


def test_the_panel_of_a_query_says_what_each_method_found():
    text = "\n".join(query_sections([region(), region()]))  # two regions of one name
    well_formed(text)
    assert "town <b>" not in text
    first, second = re.findall(r"<section.*?</section>", text, re.S)[:2]
    assert "Query 7: wrong. Place 4 was found, 30.0 m away, score 0.500; the nearest, 3," in first
    assert '<li class="wrong">DeepRING: wrong 30.0 m</li></ul>' in first  # RING was not asked
    assert '<li class="right">RING: right 2.0 m</li>' in second
    assert 'class="query first"' in first
    assert "Score over the turn" in first
    assert "Score over the turn" not in second
    assert "turned by the method: turn 52°" in first


def test_without_pictures_the_map_is_shown_alone():
    text = "\n".join(query_sections([region(views=[])]))
    well_formed(text)
    assert "<section" not in text
    assert "query 7: wrong; found 30.0 m away, nearest 2.0 m" in text


def test_ticks_are_round_and_within():
    assert svg.round_ticks(-3, 3) == [-2, 0, 2]
    assert svg.round_ticks(0.93, 0.99, 3) == pytest.approx([0.95])
    assert svg.round_ticks(1, 1) == [1]


def test_what_lies_outside_is_drawn_at_the_edge():
    axis = svg.rate_axis("x")
    plot = svg.Plot(axis, axis)
    assert plot.at(2, -1) == plot.at(1, 0)
