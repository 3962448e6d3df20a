import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.data.poses.matching import match_scans
from deepring.data.poses.pose_tables import read_table, stamped_rows
from deepring.data.poses.trajectory import Trajectory
from deepring.data.scans.listing import Listing
from deepring.errors import DeepringError

MS = 1_000_000


def planar(yaw, x, y=0.0):
    zero = np.zeros_like(np.asarray(yaw, dtype=float))
    return pose_from(
        rotation_from_rpy(zero, zero, yaw),
        np.stack(np.broadcast_arrays(np.asarray(x, dtype=float), y, zero), axis=-1),
    )


def straight(stamps):
    """Poses that drive along x at one metre a millisecond."""
    stamps = np.asarray(stamps)
    return Trajectory(stamps, planar(np.zeros(len(stamps)), stamps / MS))


def circle(times_s, speed=10.0, turn=0.5):
    """A constant speed and rate of turn, in closed form."""
    yaw = turn * times_s
    radius = speed / turn
    return planar(yaw, radius * np.sin(yaw), radius * (1 - np.cos(yaw)))


def test_interpolation_follows_a_constant_turn():
    pose_times = np.arange(0, 20, 0.01)
    scan_times = np.linspace(0.0, 19.9, 777)
    drive = Trajectory(np.rint(pose_times * 1e9), circle(pose_times))
    stamps = np.rint(scan_times * 1e9).astype(np.int64)
    poses, valid = drive.interpolate(stamps, 0.05)
    expected = circle(stamps / 1e9)
    assert valid.all()
    # The chord of a 10 ms arc is at most v w dt^2 / 8 = 63 um off; yaw is exact under slerp.
    assert np.abs(poses[:, :3, 3] - expected[:, :3, 3]).max() < 1e-4
    assert np.abs(poses[:, :3, :3] - expected[:, :3, :3]).max() < 1e-7
    # The misreading: taking the nearest pose is off by up to 5 cm.
    nearest = circle(np.rint(stamps / 1e7) * 0.01)
    assert np.abs(nearest[:, :3, 3] - expected[:, :3, 3]).max() > 0.03


def test_rotation_takes_the_short_way_across_the_yaw_wrap():
    drive = Trajectory([0, 10 * MS], planar([np.pi - 0.1, -np.pi + 0.1], [0.0, 1.0]))
    poses, valid = drive.interpolate([5 * MS], 0.05)
    assert valid[0]
    assert abs(abs(yaw_of(poses)[0]) - np.pi) < 1e-9
    # The misreading: the mean of the two yaw numbers points the other way.
    assert abs((np.pi - 0.1 + -np.pi + 0.1) / 2) < 1e-12


@pytest.mark.parametrize(
    ("stamp_ms", "valid"),
    [
        (0, True),  # a pose of exactly that stamp, however far the next one is
        (10, True),
        (25, True),  # 15 ms after one, 5 ms before the next
        (-1, False),  # nothing is extrapolated, however near the first pose is
        (131, False),
        (40, False),  # 10 ms after a pose, but the next one is 90 ms away
        (80, False),
        (130, True),
    ],
)
def test_both_bracketing_poses_must_be_within_the_tolerance(stamp_ms, valid):
    drive = straight(np.array([0, 10, 30, 130]) * MS)
    poses, mask = drive.interpolate([stamp_ms * MS], 0.02)
    assert mask[0] == valid
    if valid:
        assert poses[0, 0, 3] == pytest.approx(stamp_ms)
    else:
        assert np.isnan(poses).all()


def test_tolerance_is_inclusive_and_exact_to_the_nanosecond():
    drive = straight([0, 100 * MS])
    assert drive.interpolate([50 * MS], 0.05)[1][0]
    assert not drive.interpolate([50 * MS + 1], 0.05)[1][0]


def test_nan_rows_doubles_and_disorder_are_counted():
    stamps = np.array([0, 10, 20, 15, 30, 30, 40]) * MS
    poses = planar(np.zeros(7), [np.nan, 10, 20, 15, 30, 999, 40])
    drive = Trajectory(stamps, poses)
    np.testing.assert_array_equal(drive.stamps, np.array([10, 15, 20, 30, 40]) * MS)
    np.testing.assert_array_equal(drive.poses[:, 0, 3], [10, 15, 20, 30, 40])
    assert drive.bad_poses == 3  # the NaN row, the late row, the second row at 30


@settings(max_examples=40, deadline=None)
@given(st.permutations(list(range(12))))
def test_any_order_of_rows_gives_the_same_drive(order):
    stamps = np.arange(12) * MS
    poses = planar(np.zeros(12), np.arange(12))
    drive = Trajectory(stamps[order], poses[order])
    np.testing.assert_array_equal(drive.stamps, stamps)
    np.testing.assert_array_equal(drive.poses, poses)


@pytest.mark.parametrize(
    "rotation",
    [
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, -1.0]),
        2 * np.eye(3),
        np.full((3, 3), 1e300),
        np.full((3, 3), np.inf),
    ],
)
def test_rows_without_a_rotation_are_dropped(rotation):
    poses = pose_from(np.stack([np.eye(3), rotation]), np.zeros((2, 3)))
    drive = Trajectory([0, 1], poses)
    assert len(drive) == 1
    assert drive.bad_poses == 1


def test_no_usable_row_is_an_error_that_names_the_source():
    with pytest.raises(DeepringError, match=r"truth\.csv: none of its 2 pose rows"):
        Trajectory([0, 1], np.full((2, 4, 4), np.nan), "truth.csv")


def test_misshapen_arrays_are_refused():
    with pytest.raises(ValueError, match=r"expected \(n,\), \(n, 4, 4\)"):
        Trajectory([0, 1], np.eye(4)[None])


@pytest.mark.parametrize("tolerance", [-0.1, float("nan"), float("inf")])
def test_a_tolerance_that_is_none_is_refused(tolerance):
    with pytest.raises(DeepringError, match="pose_tolerance"):
        straight([0, 1]).interpolate([0], tolerance)


def test_a_whole_session_of_stamps_is_quick():
    stamps = np.arange(835_469, dtype=np.int64) * 10 * MS
    drive = Trajectory(stamps, np.broadcast_to(np.eye(4), (len(stamps), 4, 4)))
    scans = np.linspace(0, stamps[-1], 28_127).astype(np.int64)
    start = time.perf_counter()
    _, valid = drive.interpolate(scans, 0.05)
    assert valid.all()
    assert time.perf_counter() - start < 2.0


def test_match_leaves_out_and_counts_scans_without_a_pose(tmp_path):
    files = tuple(tmp_path / f"{i}.bin" for i in range(3))
    listing = Listing(files, np.array([5, 15, 500]) * MS, ("x.bin: empty",))
    scans = match_scans(listing, straight(np.arange(0, 30, 10) * MS), 0.05)
    assert scans.files == files[:2]
    assert scans.skipped.without_pose == 1
    assert scans.skipped.broken == ("x.bin: empty",)
    np.testing.assert_allclose(scans.poses[:, 0, 3], [5, 15])


def test_match_of_another_drive_names_both_spans(tmp_path):
    listing = Listing((tmp_path / "1.bin",), np.array([7_000_000_000]), ())
    with pytest.raises(DeepringError, match=r"scans run from 7\.000 s.*poses from 0\.000 s"):
        match_scans(listing, straight([0, MS]), 0.05)


def test_stamps_in_nanoseconds_are_read_exactly(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("1566279795718079314, 1.5, 2.5\n")
    row = read_table(path, stamped_rows(2), ",", "a stamp and 2 numbers")[0]
    assert row["stamp"] == 1566279795718079314
    assert int(float("1566279795718079314")) != row["stamp"]  # the misreading, through float64
    np.testing.assert_array_equal(row["values"], [1.5, 2.5])


@pytest.mark.parametrize(
    "text", ["", "stamp,x,y\n1,2,3\n", "1,2\n", "1,2,3\n1,2\n", "1.5e3,2,3\n", "9" * 30 + ",2,3\n"]
)
def test_a_table_that_is_none_is_an_error(tmp_path, text):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(DeepringError, match=r"poses\.csv: .*a stamp and 2 numbers"):
        read_table(path, stamped_rows(2), ",", "a stamp and 2 numbers")


@pytest.mark.parametrize("bad", ["1,2", "1,2,3,4", "1,2,x", "1.5,2,3", "9223372036854775808,2,3"])
def test_the_first_row_that_is_none_is_shown(tmp_path, bad):
    path = tmp_path / "poses.csv"
    path.write_text(f"# a comment\n1,2,3\n\n{bad}\nand worse\n")
    with pytest.raises(DeepringError, match=rf"poses\.csv: line 4 reads '{bad}', .*; expected"):
        read_table(path, stamped_rows(2), ",", "a stamp and 2 numbers")


def test_a_table_that_is_binary_or_missing_is_an_error(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_bytes(b"\xff\xfe\x00\x9f\n")
    for file, reason in ((path, "is not text"), (tmp_path / "none.csv", "cannot be read")):
        with pytest.raises(DeepringError, match=rf"{file.name}: {reason}.*a stamp and 2 numbers"):
            read_table(file, stamped_rows(2), ",", "a stamp and 2 numbers")
