"""What stands in the figure of a comparison."""

import numpy as np
import pytest

from deepring.errors import DeepringError
from deepring.paper.comparison_figures import comparison_figure
from deepring.reports.style import PALETTE, save

CURVE = ([0.5, 0.25], [0.4, 1.0])
PANELS = {
    "sim_nclt, in-domain": {"RING": [CURVE, CURVE], "DeepRING": [CURVE]},
    "sim_nclt, cross-domain": {"DeepRING": [CURVE], "DiSCO": [CURVE] * 3},
}


def lines(axes):
    """Drawn lines as (colour, points), without those that stand for the legend."""
    found = [(line.get_color(), line.get_xydata().tolist()) for line in axes.lines]
    return [(colour, points) for colour, points in found if points]


def legend(figure):
    (only,) = figure.legends
    return {
        text.get_text(): line.get_color()
        for text, line in zip(only.get_texts(), only.get_lines(), strict=True)
    }


def test_a_panel_a_test_and_a_line_a_seed(tmp_path):
    figure = comparison_figure(PANELS, radius=10.0)
    assert [axes.get_title(loc="left") for axes in figure.axes] == list(PANELS)
    assert [len(lines(axes)) for axes in figure.axes] == [3, 4]
    save(figure, tmp_path / "curves.png", dpi=40)


def test_a_method_has_one_colour_in_all_panels_and_stands_in_the_legend_once():
    figure = comparison_figure(PANELS, radius=10.0)
    colours = legend(figure)
    assert list(colours) == ["RING", "DeepRING", "DiSCO"]
    assert list(colours.values()) == list(PALETTE[:3])
    first, second = ([colour for colour, _ in lines(axes)] for axes in figure.axes)
    assert first == [colours["RING"], colours["RING"], colours["DeepRING"]]
    assert second == [colours["DeepRING"], *[colours["DiSCO"]] * 3]


def test_a_curve_begins_at_recall_zero_with_its_first_precision():
    figure = comparison_figure({"t": {"RING": [CURVE]}}, radius=10.0)
    ((_, points),) = lines(figure.axes[0])
    assert points == [[0.0, 0.5], [0.4, 0.5], [1.0, 0.25]]


def test_the_radius_is_named():
    text = comparison_figure(PANELS, radius=12.5).get_suptitle()
    assert "within 12.5 m" in text


@pytest.mark.parametrize(
    ("number", "rows", "columns"), [(1, 1, 1), (2, 1, 2), (3, 2, 2), (4, 2, 2)]
)
def test_panels_lie_in_two_columns(number, rows, columns):
    panels = {f"test {k}": {"RING": [CURVE]} for k in range(number)}
    grid = comparison_figure(panels, radius=10.0).axes[0].get_gridspec()
    assert (grid.nrows, grid.ncols) == (rows, columns)


@pytest.mark.parametrize(
    ("panels", "message"),
    [
        ({}, "panels: none given"),
        ({"t": {}}, r"panels\['t'\]: no curve"),
        ({"t": {"RING": []}}, r"panels\['t'\]: no curve"),
        (
            {"t": {"RING": [CURVE, ([0.5], [0.4, 1.0])]}},
            r"panels\['t'\]\['RING'\]\[1\]: precision \(1,\), recall \(2,\)",
        ),
        ({"t": {"RING": [(np.zeros(0), np.zeros(0))]}}, "t >= 1"),
    ],
)
def test_unusable_panels_are_refused(panels, message):
    with pytest.raises(DeepringError, match=message):
        comparison_figure(panels, radius=10.0)
