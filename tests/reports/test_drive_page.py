"""The picture and the page of a drive."""

import numpy as np

from deepring.core.rigid import pose_from
from deepring.localization.drives.drive_result import DriveResult, Truth
from deepring.localization.drives.loop_graph import Loop, LoopGraph, Track
from deepring.localization.drives.pose_graph import Optimized
from deepring.reports.drive_figure import drive_figure
from deepring.reports.drive_page import drive_page
from deepring.reports.style import png

N = 30


def result(optimized=True, truth=True):
    places = np.column_stack([np.arange(N), np.zeros(N), np.zeros(N)])
    poses = pose_from(np.tile(np.eye(3), (N, 1, 1)), places)
    names = [f"<scan {k}>.npy" for k in range(N)]
    doubts = ("the odometry was lost & found",)
    track = Track("a $b$ <drive>", np.arange(N), names, poses, None, True, 0, doubts)
    rows = np.arange(0, N, 3)
    loops = [
        Loop(8, 0, np.eye(4), 0.5, 2.0, 0.9, refined=True),
        Loop(9, 1, np.eye(4), 0.4, np.inf, 0.8, refined=True),
    ]
    graph = LoopGraph(rows, poses[rows], None, loops, breaks=(5,))
    done = Optimized(poses[rows], np.array([True, False])) if optimized else None
    return DriveResult(track, graph, -1.7, done, Truth.whole(poses) if truth else None)


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


def test_the_page_is_whole_and_takes_names_as_text():
    done = result()
    page = drive_page(done, drive_figure(done))
    assert page.count("data:image/png;base64,") == 1
    for word in ("http", "<script", "<scan 0>", "<drive>"):
        assert word not in page
    for word in ("&lt;scan 0&gt;.npy", "lost &amp; found", "RPE over 10 m", "0.00 m", "rejected"):
        assert word in page
    plain = result(optimized=False, truth=False)
    assert "RPE" not in drive_page(plain, drive_figure(plain))
