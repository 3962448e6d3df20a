"""The page of a map."""

import re

import numpy as np

from deepring.localization.map import Map
from deepring.reports.map_page import map_page
from deepring.reports.places_figure import Marks, places_figure
from helpers.networks import small_network
from helpers.small_maps import PLACES, small_map

FACTS = [("map", "a.map, 1.0 MB"), ("places", "3")]


def test_the_page_has_facts_places_and_images_and_needs_nothing_else():
    path = np.array([[0.0, 0.0], [10.0, 10.0]])
    page = map_page("a.map", small_map(), FACTS, [path], ["x.npy: nothing stands out"])
    assert page.count("data:image/png;base64,") == 1 + 2 * 3  # the map; image and sinogram of each
    assert "a.map, 1.0 MB" in page
    assert "x.npy: nothing stands out" in page
    assert "c.npy, number 2: " in page
    for word in ("http", "<script", "<link", "url("):
        assert word not in page
    assert not re.findall(r'(?:src|href)="(?!data:image/png;base64,)', page)
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
    marks = [Marks("found", PLACES[:1, :2] + utm, "#000000", "o")]
    off = [(PLACES[0, :2] + utm, PLACES[1, :2] + utm)]
    figure = places_figure(PLACES[:, :2] + utm, [PLACES[:, :2] + utm], marks, off)
    (axes,) = figure.axes
    # The lowest y is below 4 037 000, so the kilometre below it counts.
    assert axes.get_xlabel() == "x − 345 000 (m)"
    assert axes.get_ylabel() == "y − 4 036 000 (m)"
    places, found = (dots for dots in axes.collections if dots.get_label()[-1] == ")")
    np.testing.assert_allclose(places.get_offsets(), PLACES[:, :2] + [0, 1000])
    assert found.get_label() == "found (1)"
    np.testing.assert_allclose(axes.lines[0].get_xydata(), PLACES[:, :2] + [0, 1000])
    assert len(figure.legends[0].get_texts()) == 4


def test_one_place_and_none_can_be_drawn():
    for places in (PLACES[:1, :2], PLACES[:0, :2]):
        width, height = places_figure(places).get_size_inches()
        assert 0.3 < height / width < 2
