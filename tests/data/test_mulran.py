import os
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.data.readers.mulran import list_mulran, open_mulran
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError, DeepringError

SAME_FOLDER = settings(
    deadline=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
START = 1566279795718079314  # nanoseconds
EAST, NORTH = 345090.0743, 4037591.323


def encode(rows):
    return b"".join(struct.pack("<ffff", *row) for row in rows)


def write_drive(root, folder="Ouster", yaw=0.0, count=4):
    """One scan every 100 ms, poses every 10 ms that drive east at 10 m/s."""
    scans = root / folder
    scans.mkdir(parents=True)
    for i in range(count):
        (scans / f"{START + i * 100_000_000}.bin").write_bytes(encode([(5, 1, -1, 80)]))
    lines = []
    for i in range(count * 10):
        pose = pose_from(rotation_from_rpy(0, 0, yaw), [EAST + 0.1 * i, NORTH, 30.0])
        numbers = ",".join(repr(float(v)) for v in pose[:3].ravel())
        lines.append(f"{START + i * 10_000_000},{numbers}")
    (root / "global_pose.csv").write_text("\n".join(lines) + "\n")
    return root


@SAME_FOLDER
@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 40), st.just(4)),
        elements=st.floats(-500, 500, width=32),
    )
)
def test_decoding_inverts_encoding_and_missing_returns_go(tmp_path, rows):
    path = tmp_path / "1.bin"
    path.write_bytes(encode(rows))
    present = rows[(rows[:, :3] != 0).any(axis=1), :3]
    if len(present):
        points = read_scan(path, "mulran")
        assert points.dtype == np.float32
        np.testing.assert_array_equal(points, present)
    else:
        with pytest.raises(BrokenScanError, match="at least one valid point"):
            read_scan(path, "mulran")


@SAME_FOLDER
@given(st.binary(max_size=160))
def test_any_bytes_decode_or_are_a_broken_scan(tmp_path, data):
    path = tmp_path / "1.bin"
    path.write_bytes(data)
    values = np.frombuffer(data[: len(data) // 16 * 16], "<f4").reshape(-1, 4)[:, :3]
    values = values[np.isfinite(values).all(axis=1)]
    values = values[(values != 0).any(axis=1)]
    if len(data) % 16 == 0 and len(values):
        np.testing.assert_array_equal(read_scan(path, "mulran"), values)
    else:
        with pytest.raises(BrokenScanError, match=r"1\.bin: \d+ (bytes|records).*expected"):
            read_scan(path, "mulran")


def test_missing_and_unusable_points_are_dropped(tmp_path):
    path = tmp_path / "1.bin"
    rows = [(0, 0, 0, 9), (1, 0, 0, 9), (np.nan, 1, 1, 0), (1, np.inf, 1, 0), (2, 2, 2, np.nan)]
    path.write_bytes(encode(rows))
    np.testing.assert_array_equal(read_scan(path, "mulran"), [[1, 0, 0], [2, 2, 2]])


@pytest.mark.parametrize("folder", ["Ouster", "sensor_data/Ouster"])
def test_every_layout_opens(tmp_path, folder):
    write_drive(tmp_path / "Sejong01", folder)
    assert list_mulran(tmp_path) == ["Sejong01"]
    session = open_mulran(tmp_path, "Sejong01")
    assert len(session) == 4
    np.testing.assert_array_equal(session.stamps, START + np.arange(4) * 100_000_000)
    np.testing.assert_array_equal(session.points(0), [[5, 1, -1]])
    assert list_mulran(tmp_path / "Sejong01") == ["Sejong01"]
    assert len(open_mulran(tmp_path / "Sejong01", "Sejong01")) == 4


def test_the_pose_is_the_lidars(tmp_path):
    """Heading north, the LiDAR stands 1.7 m north of the base and looks back."""
    write_drive(tmp_path / "Sejong01", yaw=np.pi / 2)
    tf = open_mulran(tmp_path, "Sejong01")
    offset = tf.poses[0, :3, 3] - [EAST, NORTH, 30.0]
    np.testing.assert_allclose(offset, [0.021, 1.7042, 1.8047], atol=1e-6)
    assert yaw_of(tf.poses[0]) == pytest.approx(np.radians(90 + 179.6654 - 360))
    np.testing.assert_array_equal(tf.ground_truth, tf.poses[:, :2, 3])

    bare = open_mulran(tmp_path, "Sejong01", extrinsic="none")
    np.testing.assert_allclose(bare.ground_truth[0], [EAST, NORTH], atol=1e-6)
    # The misreading: with the inverse the LiDAR is below the base and still looks back.
    inverse = open_mulran(tmp_path, "Sejong01", extrinsic="inverse")
    assert inverse.poses[0, 2, 3] == pytest.approx(30 - 1.8047, abs=1e-3)
    turn = tf.poses[0, :3, :3] @ np.linalg.inv(inverse.poses[0, :3, :3])
    assert abs(yaw_of(turn)) == pytest.approx(np.radians(2 * 0.3346), abs=1e-4)


def test_utm_coordinates_keep_their_millimetres(tmp_path):
    write_drive(tmp_path / "Sejong01")
    positions = open_mulran(tmp_path, "Sejong01", extrinsic="none").ground_truth
    expected = np.column_stack([EAST + np.arange(4), np.full(4, NORTH)])
    assert np.abs(positions - expected).max() < 1e-3
    # The misreading: float32 is off by centimetres at 4 million metres.
    assert np.abs(positions.astype(np.float32) - expected).max() > 0.05


def test_a_stamp_without_file_and_files_without_pose(tmp_path):
    root = write_drive(tmp_path / "Sejong01")
    stamps = [START + i * 100_000_000 for i in range(5)]  # one more than there are files
    (root / "ouster_front_stamp.csv").write_text("\n".join(map(str, stamps)))
    (root / "Ouster" / f"{START + 10**12}.bin").write_bytes(encode([(1, 1, 1, 1)]))
    (root / "Ouster" / f"{START + 1}.bin").write_bytes(b"")
    session = open_mulran(tmp_path, "Sejong01")
    assert len(session) == 4
    assert session.skipped.without_pose == 1
    assert len(session.skipped.broken) == 1
    assert "broken" in str(session.skipped)
    assert "without a pose" in str(session.skipped)


def test_nan_and_disordered_rows_are_counted(tmp_path):
    root = write_drive(tmp_path / "Sejong01")
    lines = (root / "global_pose.csv").read_text().splitlines()
    lines[5], lines[6] = lines[6], lines[5]
    lines.insert(0, f"{START - 10_000_000}" + ",nan" * 12)
    (root / "global_pose.csv").write_text("\n".join(lines))
    session = open_mulran(tmp_path, "Sejong01", extrinsic="none")
    assert session.skipped.bad_poses == 2
    np.testing.assert_allclose(session.positions[:, 0], EAST + np.arange(4), atol=1e-6)


def test_errors_say_what_to_do(tmp_path):
    root = write_drive(tmp_path / "Sejong01")
    with pytest.raises(DeepringError, match=r"extrinsic: 'tff', expected one of tf, inverse"):
        open_mulran(tmp_path, "Sejong01", extrinsic="tff")
    with pytest.raises(DeepringError, match=r"no scans of session 'KAIST01'"):
        open_mulran(tmp_path, "KAIST01")
    with pytest.raises(DeepringError, match="pose_tolerance"):
        open_mulran(tmp_path, "Sejong01", pose_tolerance=-1)
    os.truncate(root / "global_pose.csv", 40)
    with pytest.raises(DeepringError, match=r"global_pose\.csv: .*12 numbers"):
        open_mulran(tmp_path, "Sejong01")
    (root / "global_pose.csv").unlink()
    with pytest.raises(DeepringError, match=r"no global_pose\.csv in .*Sejong01"):
        open_mulran(tmp_path, "Sejong01")
    for file in (root / "Ouster").iterdir():
        file.unlink()
    (root / "global_pose.csv").touch()
    with pytest.raises(DeepringError, match="no scans"):
        open_mulran(tmp_path, "Sejong01")
