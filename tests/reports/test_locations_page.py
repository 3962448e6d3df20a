"""The page of located scans, and how a scan is laid over its place."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.data.packed_rasters import unpack
from deepring.localization.calibration import LocalizationTrials
from deepring.reports.errors_plot import errors_plot
from deepring.reports.located_scan import cell_centres, lie_in_place, located_pose
from deepring.reports.locations_page import locations_page, selection
from helpers.html_pages import lines_of, marks_of, row_of, table_rows, well_formed
from helpers.small_maps import GROUND_Z, PLACES, located, location, pose, small_map


@pytest.fixture(scope="module")
def place_map():
    return small_map()


def test_the_page_counts_trust_doubts_refusals_and_errors(place_map):
    scans = [
        located(place_map, "right.npy", location(x=1.0), (1.3, 0.4, 0.0)),  # off by 0.5 m
        located(place_map, "wrong.npy", location(1, 12.0, 4.0, name="b.npy"), (12.0, 7.0, 0.0)),
        located(place_map, "turned.npy", location(), (0.0, 0.0, math.radians(8.0))),
        located(place_map, "faint.npy", location(doubt="fit", fit=0.1), (0.0, 1.0, 0.0)),
        located(place_map, "twice.npy", location(doubt="ratio", ratio=1.0), (60.0, 0.0, 0.0)),
    ]
    page = locations_page("a.map", place_map, scans, ["d.npy: nothing stands out"])

    for cells in (
        ("scans", 6),
        ("trusted", 3),
        ("trusted wrongly", 2),
        ("doubtful: fit", "1, fits too little"),
        ("doubtful: ratio", "1, fits elsewhere nearly as well"),
        ("refused", 1),
        ("all", 5, 2, "1.00 m", "48.60 m", "60.00 m", "0.00°"),
        ("trusted", 3, 1, "0.50 m", "2.75 m", "3.00 m", "0.00°"),
        ("doubtful", 2, 1, "30.50 m", "57.05 m", "60.00 m", "0.00°"),
    ):
        assert row_of(*cells) in page
    rows = table_rows(page)
    for row in (
        ["right.npy", "1.00", "0.00", "0.0", "0.50", "2.00", "yes", "0.50", "0.00", "a.npy"],
        ["faint.npy", "0.00", "0.00", "0.0", "0.10", "2.00", "no: fit", "1.00", "0.00", "a.npy"],
    ):
        assert row in rows
    well_formed(page)
    assert "1 of the 4 scans within 20 m of a place are trusted and right" in page
    assert "2 of 3 trusted ones are wrong" in page
    assert "d.npy: nothing stands out" in page
    assert page.count("data:image/png;base64,") == 2 * 5  # of each scan its place and itself
    assert "<img" not in page
    drawing = page[page.index('<svg class="map" viewBox="0 0 460') :]
    assert [len(marks_of(drawing, kind)) for kind in ("right", "wrong", "fit", "ratio")] == [
        *(1, 2, 1, 1)
    ]
    assert len(lines_of(drawing, "off")) == 2  # only those that are trusted wrongly
    assert "http" not in page
    assert "another world" not in page


def test_refined_poses_have_errors_of_their_own(place_map):
    scan = located(place_map, "s", location(x=1.0), (1.0, 0.6, 3.1))
    refined = replace(scan, refined=pose(1.0, 0.5, -3.1, z=4.0))
    page = locations_page("a.map", place_map, [scan, refined])
    cells = ("refined", 1, 1, *["0.10 m"] * 3, "4.77°")  # across the half turn
    assert row_of(*cells) in page
    doubtful = located(place_map, "d", location(doubt="few cells"))
    assert ">cannot tell: few cells</td>" in locations_page("a.map", place_map, [doubtful])


def test_poses_of_another_world_are_doubted(place_map):
    scans = [located(place_map, "a", location(), (900.0, 50.0, 1.0))]
    assert "another world than the map" in locations_page("a.map", place_map, scans)


def test_without_true_poses_there_are_no_errors_and_names_are_text(place_map):
    scan = located(place_map, "<img src=x>\u202e", location(name="$<b>"))
    page = locations_page("<m>", place_map, [scan] * 1002, ["<script>"])
    for word in ("Errors", "<img src=x", "<script", "<m>", "$<b>", "\u202e", "wrongly"):
        assert word not in page
    assert "And 2 more; --as csv" in page
    assert len(page) < 5e6
    assert "Errors" not in locations_page("a.map", place_map, [], ["x"])


def test_a_scan_lies_on_what_its_place_shows(place_map):
    """Occupied cells of a scan that is located rightly meet those of the place."""
    raster = place_map.raster
    true = (10.0, 1.0, 2.5)
    scan = located(place_map, "s", location(1, *true), true)
    image = unpack(scan.image[None], raster)[0].astype(bool)
    shown = place_map.places.images(torch.tensor([1]))[0].numpy().astype(bool)

    def share(found, place):
        lie = lie_in_place(found, place)
        seen = np.pad(cell_centres(image, raster.extent), ((0, 0), (0, 1)))
        cells = turn_points(seen, -lie.turn)[:, :2] + lie.position
        rows = np.floor((cells + raster.extent) / (2 * raster.extent) * raster.cells).astype(int)
        rows = rows[((rows >= 0) & (rows < raster.cells)).all(axis=1)]
        near = shown | np.roll(shown, 1, 0) | np.roll(shown, -1, 0)
        near = near | np.roll(near, 1, 1) | np.roll(near, -1, 1)
        return near[tuple(rows.T)].mean()

    assert share(scan.location, PLACES[1]) > 0.95
    assert share(location(1, 10.0, 1.0, -2.5), PLACES[1]) < 0.7  # the turn the wrong way round
    assert share(scan.location, PLACES[1] * [1, 1, -1]) < 0.7
    assert share(location(1, 14.0, 7.0, 2.5), PLACES[1]) < 0.7  # the shift the wrong way round


def test_a_located_pose_stands_on_the_ground_of_its_place(place_map):
    scan = located(place_map, "s", location(1, 10.0, 1.0, 2.5))
    np.testing.assert_allclose(located_pose(scan, place_map), pose(10.0, 1.0, 2.5, z=10.0))
    higher = replace(scan, ground_z=GROUND_Z - 0.5)
    assert located_pose(higher, place_map)[2, 3] == pytest.approx(10.5)
    refined = replace(scan, refined=pose(1, 2, 3, z=4))
    np.testing.assert_array_equal(located_pose(refined, place_map), pose(1, 2, 3, z=4))


def test_every_kind_is_shown():
    kinds = ["a"] * 50 + ["b"] + ["c"] * 2
    shown = selection(list(range(53)), kinds, 8)
    assert len(shown) == 8
    assert {50, 51, 52} < set(shown)
    assert {0, 49} & set(shown)
    assert selection([], [], 8) == []
    assert selection([1, 2], ["a", "a"], 8) == [1, 2]


def test_errors_beyond_the_axis_are_counted_in_the_last_bar():
    metres = np.array([0.1, 0.3, 4.99, 5.0, 800.0])
    trials = LocalizationTrials(*[metres] * 2, metres, *[metres] * 3)
    plot = errors_plot(trials, np.array([True, True, True, True, False]))
    assert re.findall("<title>(.*?)</title>", plot) == [
        *("0 to 0.25 m: 1 trusted", "0.25 to 0.5 m: 1 trusted", "4.75 to 5 m: 1 trusted"),
        *("more than 5 m: 1 trusted", "more than 5 m: 1 doubtful"),
    ]
    bars = re.findall(r'class="bar (\w+)" d="M([\d.]+) ([\d.]+)H[\d.]+V([\d.]+)', plot)
    (_, x, _, top), (kind, x_above, foot, _) = bars[-2:]
    assert (kind, x_above, foot) == ("doubtful", x, top)  # on top of the trusted ones
    assert "trusted (4)" in plot
