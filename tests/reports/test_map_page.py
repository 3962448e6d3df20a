"""The page of a map."""

import re

import numpy as np

from deepring.localization.map import Map
from deepring.reports.map_page import map_page
from deepring.reports.places_drawing import Marked, places_drawing
from helpers.html_pages import lines_of, marks_of, well_formed
from helpers.networks import small_network
from helpers.small_maps import PLACES, small_map

FACTS = [("map", "a.map, 1.0 MB"), ("places", "3")]


def test_the_page_has_facts_places_and_images_and_needs_nothing_else():
    path = np.array([[0.0, 0.0], [10.0, 10.0]])
    page = map_page("a.map", small_map(), FACTS, [path], ["x.npy: nothing stands out"])
    well_formed(page)
    assert page.count("data:image/png;base64,") == 2 * 3  # image and sinogram of each
    assert "a.map, 1.0 MB" in page
    assert "x.npy: nothing stands out" in page
    assert "c.npy, number 2: " in page
    for word in ("http", "<script", "<link", "url("):
        assert word not in page
    assert not re.findall(r'(?:src|href)="(?!data:image/png;base64,|#place-)', page)
    assert "prefers-color-scheme: dark" in page


def test_names_and_reasons_are_text_and_the_others_are_counted():
    names = ["<i>a</i>", "$b_{$", 'c"\u202e']
    page = map_page("<b>.map", small_map(names), FACTS, (), ["<script>"] * 60)
    for word in ("<i>", "<script", "<b>", "\u202e"):
        assert word not in page
    assert "&lt;i&gt;a&lt;/i&gt;" in page
    assert "And 10 more." in page


def test_a_map_without_places_has_a_page():
    assert "None." in map_page("a.map", Map(small_network()), FACTS)


def test_places_far_from_the_origin_are_drawn_relative_to_a_round_number():
    utm = np.array([345_000.0, 4_037_000.0])
    marked = [Marked("found", PLACES[:1, :2] + utm, "right")]
    off = [(PLACES[0, :2] + utm, PLACES[1, :2] + utm)]
    legend, drawing = places_drawing(PLACES[:, :2] + utm, [PLACES[:, :2] + utm], marked, off).split(
        "</ul>"
    )
    # The lowest y is below 4 037 000, so the kilometre below it counts.
    assert "x − 345 000 (m)" in drawing
    assert "y − 4 036 000 (m)" in drawing
    assert [*re.findall("<li>.*?</svg>([^<]*)", legend)] == [
        *("path", "places (3)", "found (1)", "to the true position")
    ]
    places = marks_of(drawing, "place")
    assert marks_of(drawing, "right") == places[:1]
    assert lines_of(drawing, "off") == [places[:2]]
    assert lines_of(drawing, "driven") == [places]
    drawn, true = (np.diff(points, axis=0) for points in (places, PLACES[:, :2]))
    scale = drawn / true * [1, -1]  # y grows upwards
    np.testing.assert_allclose(scale, scale[0, 0], rtol=0.01)


def test_one_place_can_be_drawn_and_the_axes_keep_one_scale():
    for places in (PLACES[:1, :2], PLACES[:, :2] * [1, 0], PLACES[:, :2] * [0, 1]):
        drawing = places_drawing(places).split("</ul>")[1]
        width, height = map(float, re.findall(r'viewBox="0 0 (460) ([\d.]+)"', drawing)[0])
        assert 0.3 < height / width < 2
        for x, y in marks_of(drawing, "place alone"):
            assert 0 < x < width
            assert 0 < y < height


def test_equal_marks_are_drawn_once():
    places = np.repeat(PLACES[:, :2], 1000, axis=0)
    drawing = places_drawing(places, (), [Marked("found", places, "wrong")])
    assert "places (3000)" in drawing
    drawing = drawing.split("</ul>")[1]
    assert len(marks_of(drawing, "place")) == len(marks_of(drawing, "wrong")) == 3
