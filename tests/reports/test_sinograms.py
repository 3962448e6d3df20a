"""The figure of a scan, its sinogram and its turned twin."""

import numpy as np
import pytest

from deepring.errors import DeepringError
from deepring.reports.sinograms import sinogram_figure
from deepring.reports.style import save

ROWS, SIDE, EXTENT = 12, 8, 70.0


def inputs():
    bev = np.zeros((SIDE, SIDE), bool)
    bev[7, 6] = True  # far forward, to the left
    sinogram = np.random.default_rng(0).random((ROWS, SIDE))
    correlation = np.zeros(ROWS)
    correlation[4] = 1.0
    return bev, sinogram, np.roll(sinogram, 4, axis=0), correlation


def test_what_lies_forward_and_left_is_drawn_up_and_left():
    drawn = sinogram_figure(*inputs(), EXTENT).axes[0].images[0]
    row, column = np.argwhere(drawn.get_array())[0]
    left, right, low, high = drawn.get_extent()
    x = low + (row + 0.5) / SIDE * (high - low)
    y = left + (column + 0.5) / SIDE * (right - left)
    cell = 2 * EXTENT / SIDE
    assert (x, y) == (7.5 * cell - EXTENT, 6.5 * cell - EXTENT), "the labels tell the truth"
    assert (row, column) == (7, 1)
    assert drawn.origin == "lower"


def test_the_peak_is_marked_in_rows_and_degrees_beside_the_true_turn(tmp_path):
    figure = sinogram_figure(*inputs(), EXTENT, true_turn=-238.0)
    texts = [text.get_text() for text in figure.axes[3].get_legend().get_texts()]
    assert texts == ["true turn 122.0°", "peak 120° (4 of 12 rows)"]
    assert [120.0, 1.0] in [line.get_xydata()[0].tolist() for line in figure.axes[3].lines]
    save(figure, tmp_path / "sinogram.png", dpi=40)


def test_both_sinograms_share_one_colour_scale():
    bev, sinogram, turned, correlation = inputs()
    figure = sinogram_figure(bev, sinogram, turned * 3, correlation, EXTENT)
    assert {axes.images[0].get_clim() for axes in figure.axes[1:3]} == {(0.0, 3 * sinogram.max())}


@pytest.mark.parametrize("wrong", range(4))
def test_shapes_that_do_not_fit_are_refused(wrong):
    arguments = list(inputs())
    arguments[wrong] = arguments[wrong][None]
    with pytest.raises(DeepringError, match="drop batch axes"):
        sinogram_figure(*arguments, EXTENT)
