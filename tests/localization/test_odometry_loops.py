"""One pass over a recording: poses, keyframes and loops, and what is left out."""

import numpy as np
import pytest

from deepring.data.left_out import LeftOut
from deepring.errors import DataError
from deepring.localization.drives.loops import LoopSettings
from deepring.localization.drives.odometry_loops import find_loops_by_odometry
from deepring.localization.drives.pose_graph import optimize
from deepring.localization.drives.trajectory_error import absolute_error
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.localization.registration.refinement import RefinementSettings
from deepring.methods.network_file import load_network
from helpers.recorded_drives import HEIGHT, START, laps, recording, town

POSES = laps(55, radius=12.0, rounds=1.35)
SETTINGS = LoopSettings(spacing=3.0, recent=40.0, refinement=RefinementSettings())


def empty_map():
    thresholds = AcceptanceThresholds(fit=0.2, ratio=1.1)
    return Map(load_network("shipped").method, -HEIGHT, thresholds=thresholds)


@pytest.fixture(scope="module")
def found():
    """A drive of which two scans are broken."""
    left_out, calls = LeftOut(), []
    track, graph = find_loops_by_odometry(
        recording(town(), POSES, broken=(7, 30)),
        empty_map(),
        SETTINGS,
        progress=lambda done, total: calls.append((done, total)),
        left_out=left_out,
    )
    return track, graph, left_out, calls


def test_broken_scans_are_left_out_and_the_odometry_goes_on(found):
    track, _, left_out, calls = found
    used = [k for k in range(55) if k not in (7, 30)]
    assert track.scans.tolist() == used
    assert track.stamps.tolist() == [START + k * 10**8 for k in used]
    assert len(left_out) == 2
    assert "7.npy: 0 bytes" in str(left_out)
    assert absolute_error(track.poses, POSES[used]).rmse < 0.5
    assert calls == [(k + 1, 55) for k in range(55)]


def test_keyframes_are_apart_and_loops_true_in_three_dimensions(found):
    track, graph, _, _ = found
    steps = np.linalg.norm(np.diff(graph.poses[:, :2, 3], axis=0), axis=1)
    assert (steps > 3).all()
    assert (steps < 8).all()
    np.testing.assert_array_equal(graph.poses, track.poses[graph.scans])
    assert len(graph.loops) >= 3
    true = POSES[track.scans[graph.scans]]
    for loop in graph.loops:
        assert loop.refined
        expected = np.linalg.inv(true[loop.earlier]) @ true[loop.keyframe]
        assert np.abs(loop.transform - expected).max() < 0.2
    result = optimize(graph)
    assert result.accepted.mean() > 0.8


def test_a_break_is_known_to_the_graph():
    jumped = POSES[:24].copy()
    jumped[12:, :2, 3] += [25.0, 30.0]
    place_map = empty_map()
    track, graph = find_loops_by_odometry(recording(town(), jumped), place_map, SETTINGS)
    [broken] = graph.breaks
    assert track.scans[graph.scans[broken]] == 12
    assert "lost at 1 of 24 scans" in track.doubts[0]
    assert "12.npy" in track.doubts[0]


def test_too_many_broken_scans_are_an_error_and_leave_the_map_empty():
    place_map = empty_map()
    drive = recording(town(), POSES[:10], broken=(4, 5, 6))
    with pytest.raises(DataError, match="3 or more of 10 scans cannot be used"):
        find_loops_by_odometry(drive, place_map, SETTINGS)
    assert len(place_map) == 0
