"""The picture and the page of a drive."""

from deepring.reports.drive_drawing import drive_drawing
from deepring.reports.drive_figure import drive_figure
from deepring.reports.drive_page import drive_page
from deepring.reports.style import png
from helpers.drive_results import N, result
from helpers.html_pages import lines_of, well_formed


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


def test_the_page_is_whole_and_takes_names_as_text():
    done = result()
    page = drive_page(done)
    well_formed(page)
    assert page.count('<svg class="map" viewBox="0 0 460') == 2  # before and after
    assert "<img" not in page
    for word in ("http", "<script", "<scan 0>", "<drive>"):
        assert word not in page
    for word in ("&lt;scan 0&gt;.npy", "lost &amp; found", "RPE over 10 m", "0.00 m", "rejected"):
        assert word in page
    assert page.count('class="line odometry"') == page.count('class="line optimized"') == 2
    plain = result(optimized=False, truth=False)
    assert "RPE" not in drive_page(plain)


def test_the_drawing_breaks_no_line_across_a_break_and_joins_the_keyframes_of_loops():
    drawing = drive_drawing(result(), "optimized")
    for words in ("true poses", "trajectory", "loops (1)", "loops rejected (1)", "odometry lost"):
        assert words in drawing
    drawing = drawing.split("</ul>")[1]
    assert [len(strip) for strip in lines_of(drawing, "optimized")] == [15, N - 15]
    (truth,) = lines_of(drawing, "truth")
    (loop,), (rejected,) = lines_of(drawing, "loop"), lines_of(drawing, "loop rejected")
    assert loop == [truth[0], truth[24]]  # keyframes 0 and 8 are scans 0 and 24
    assert rejected == [truth[3], truth[27]]
    plain = drive_drawing(result(optimized=False, truth=False), "odometry")
    for words in ("true poses", "rejected"):
        assert words not in plain
