"""The picture and the page of a drive."""

from deepring.reports.drive_figure import drive_figure
from deepring.reports.drive_page import drive_page
from deepring.reports.style import png
from helpers.drive_results import N, result


def test_the_figure_shows_both_trajectories_and_breaks_no_line_across_a_break():
    figure = drive_figure(result())
    panels = figure.axes
    assert [axes.get_title(loc="left") for axes in panels] == ["before", "optimised"]
    [legend] = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert len(words) == len(set(words))
    assert {"loops (1)", "loops rejected (1)", "odometry lost", "true poses"} <= set(words)
    lengths = [len(line.get_xdata()) for line in panels[0].lines]
    assert lengths[:3] == [N, 15, N - 15]  # the truth, and the two parts
    assert png(figure).startswith(b"\x89PNG")
    assert len(drive_figure(result(optimized=False, truth=False)).axes) == 1
    assert panels[0].get_xlabel() == "x (m)"
    [panel] = drive_figure(result(), "optimized").axes
    assert panel.get_title(loc="left") == "optimised"


def test_the_page_is_whole_and_takes_names_as_text():
    done = result()
    page = drive_page(done)
    assert page.count("data:image/png;base64,") == 2  # before and after
    for word in ("http", "<script", "<scan 0>", "<drive>"):
        assert word not in page
    for word in ("&lt;scan 0&gt;.npy", "lost &amp; found", "RPE over 10 m", "0.00 m", "rejected"):
        assert word in page
    plain = result(optimized=False, truth=False)
    assert "RPE" not in drive_page(plain)
