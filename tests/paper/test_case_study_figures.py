"""The figures of the case study."""

import numpy as np
import pytest

from deepring.errors import DeepringError
from deepring.paper.case_study import DRAWN, NAMES, ErrorRow, TwinPair, View
from deepring.paper.case_study_figures import error_figure, pair_figure
from deepring.paper.moved_scans import Motion
from deepring.reports.style import save

EXTENT = 70.0


def pair():
    rng = np.random.default_rng(0)
    bevs = np.zeros((2, 8, 8), bool)
    bevs[:, 7, 6] = True  # far forward, to the left
    views = tuple(
        View(name, rng.random((2, 12, 8)), rng.random((2, 12, 5)), rng.random((12, 5)), error)
        for name, error in zip(DRAWN, (0.12, 0.71), strict=True)
    )
    return TwinPair(Motion(-90.0, (3.0, 4.0)), bevs, EXTENT, views)


def rows(unrelated=True):
    made = []
    for name, level in zip(NAMES, (0.1, 0.5, 0.6), strict=True):
        for kind, values, unit in (
            ("translation", (0.0, 10.0, 20.0), "m"),
            ("rotation", (0.0, 7.5, 15.0, 22.5), "deg"),
            ("unrelated", (None,) if unrelated else (), ""),
        ):
            for value in values:
                quartiles = (level, level - 0.02, level + 0.03)
                made.append(ErrorRow(name, kind, value, unit, 4, level + 0.01, *quartiles))
    return made


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes]


def test_a_row_a_representation_with_its_error_and_the_motion_named(tmp_path):
    figure = pair_figure(pair())
    assert len(figure.axes) == 12
    assert "Turned 270°, moved 5 m" in titles(figure)
    assert [title for title in titles(figure) if "difference" in title] == [
        "difference: 12.0%",
        "difference: 71.0%",
    ]
    save(figure, tmp_path / "pair.png", dpi=40)


def test_the_difference_has_the_colour_scale_of_its_magnitudes():
    figure, made = pair_figure(pair()), pair()
    for row, view in zip((figure.axes[:6], figure.axes[6:]), made.views, strict=True):
        assert {axes.images[0].get_clim() for axes in row[3:]} == {(0.0, view.magnitudes.max())}
        assert {axes.images[0].get_clim() for axes in row[1:3]} == {(0.0, view.images.max())}
        np.testing.assert_array_equal(row[5].images[0].get_array(), view.difference)


def test_what_lies_forward_and_left_is_drawn_up_and_left():
    drawn = pair_figure(pair()).axes[0].images[0]
    row, column = np.argwhere(drawn.get_array())[0]
    assert (row, column) == (7, 1)
    assert drawn.origin == "lower"
    assert drawn.get_extent() == [EXTENT, -EXTENT, -EXTENT, EXTENT]


def test_means_bands_and_the_two_kinds_of_turn_are_drawn(tmp_path):
    figure = error_figure(rows(), "a place")
    shifted, turned = figure.axes
    drawn = [line.get_xydata().tolist() for line in shifted.lines]
    assert [[0.0, 0.11], [10.0, 0.11], [20.0, 0.11]] in drawn
    turns = {tuple(line.get_xdata()): line.get_linestyle() for line in turned.lines}
    assert turns[0.0, 15.0] == "-", "whole rows"
    assert turns[7.5, 22.5] == ":", "between two"
    band = shifted.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((0.08, 0.13))
    assert shifted.get_ylim() == turned.get_ylim()
    assert figure.get_suptitle() == "a place"
    save(figure, tmp_path / "error.png", dpi=40)


def test_the_level_of_unrelated_scans_is_drawn_where_it_is_known():
    def levels(figure):
        return [
            line.get_ydata()[0]
            for axes in figure.axes
            for line in axes.lines
            if line.get_linestyle() == "--" and len(line.get_ydata())
        ]

    assert levels(error_figure(rows())) == pytest.approx([0.11, 0.51, 0.61] * 2)
    without = error_figure(rows(unrelated=False))
    assert levels(without) == []
    assert not any("unrelated" in text.get_text() for text in without.legends[0].get_texts())


def test_rows_of_a_missing_kind_are_refused():
    kept = [row for row in rows() if row.kind != "rotation"]
    with pytest.raises(DeepringError, match="rotation"):
        error_figure(kept)
