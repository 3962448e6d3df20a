"""The map of hits and misses."""

import numpy as np
import pytest

from deepring.errors import DeepringError
from deepring.reports.style import save
from deepring.reports.trajectory_figure import trajectory_figure

DATABASE = np.array([[0.0, 0.0], [20.0, 0.0], [40.0, 5.0]])
QUERIES = np.array([[1.0, 1.0], [21.0, 1.0], [39.0, 6.0], [300.0, 80.0]])
RIGHT = np.array([True, True, False, False])
ANSWERABLE = np.array([True, True, True, False])


def drawn(figure):
    """Legend label to positions."""
    return {dots.get_label(): dots.get_offsets() for dots in figure.axes[0].collections}


def test_each_query_is_drawn_once_under_its_outcome(tmp_path):
    figure = trajectory_figure(DATABASE, QUERIES, RIGHT, ANSWERABLE, "RING")
    dots = drawn(figure)
    np.testing.assert_array_equal(dots["map (3)"], DATABASE)
    np.testing.assert_array_equal(dots["hit (2)"], QUERIES[:2])
    np.testing.assert_array_equal(dots["miss (1)"], QUERIES[2:3])
    np.testing.assert_array_equal(dots["no place in reach (1)"], QUERIES[3:])
    assert figure.axes[0].get_aspect() == 1
    save(figure, tmp_path / "map.png", dpi=40)


def test_utm_positions_are_drawn_relative_to_a_round_number_that_the_axes_name():
    utm = np.array([345_000.0, 4_037_500.0])
    labels = ("easting", "northing")
    figure = trajectory_figure(DATABASE + utm, QUERIES + utm, RIGHT, ANSWERABLE, labels=labels)
    np.testing.assert_allclose(drawn(figure)["map (3)"], DATABASE + np.array([0, 500]))
    assert figure.axes[0].get_xlabel() == "easting − 345 000 (m)"
    assert figure.axes[0].get_ylabel() == "northing − 4 037 000 (m)"


def test_far_negative_positions_are_raised():
    figure = trajectory_figure(DATABASE - 20_500, QUERIES - 20_500, RIGHT, ANSWERABLE)
    assert figure.axes[0].get_xlabel() == "x + 21 000 (m)"
    np.testing.assert_allclose(drawn(figure)["map (3)"], DATABASE + 500)


@pytest.mark.parametrize("stretch", [(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)])
def test_straight_and_standing_drives_have_a_figure_of_sane_shape(stretch, tmp_path):
    scale = np.array(stretch)
    figure = trajectory_figure(DATABASE * scale, QUERIES * scale, RIGHT, ANSWERABLE)
    width, height = figure.get_size_inches()
    assert 0.3 < height / width < 2
    save(figure, tmp_path / "map.png", dpi=40)


def test_an_empty_database_leaves_all_queries_without_a_place():
    figure = trajectory_figure(np.zeros((0, 2)), QUERIES, RIGHT, np.zeros(4, bool))
    assert len(drawn(figure)["no place in reach (4)"]) == 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((DATABASE[:, :1], QUERIES, RIGHT, ANSWERABLE), r"database: shape \(3, 1\)"),
        ((DATABASE, QUERIES * np.nan, RIGHT, ANSWERABLE), "queries: .* 8 not finite"),
        ((DATABASE, QUERIES, RIGHT[:2], ANSWERABLE), r"right \(2,\)"),
        ((DATABASE, QUERIES, RIGHT, ANSWERABLE[:2]), r"answerable \(2,\)"),
        ((DATABASE, QUERIES[:0], RIGHT[:0], ANSWERABLE[:0]), "q >= 1"),
    ],
)
def test_unusable_input_is_refused(arguments, message):
    with pytest.raises(DeepringError, match=message):
        trajectory_figure(*arguments)
