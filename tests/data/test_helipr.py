"""HeLiPR's four sensors: real scans, every record, and where a session's poses come from."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, yaw_of
from deepring.data.readers import detect_format, list_sessions, open_session
from deepring.data.readers.helipr import AEVA_WITHOUT_INTENSITY, SENSORS, read_helipr_scan
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError, DeepringError
from helpers.real_data import real_data

SAME_FOLDER = settings(
    deadline=None,
    max_examples=40,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
START = 1689519043198786784  # nanoseconds, when the Aeva wrote no intensity yet
LATER = AEVA_WITHOUT_INTENSITY + 1
#: struct's letters as the dataset's own tools have them, and what stands behind x, y, z.
PACKED = {
    "Avia": ("<fffBBBL", (7, 16, 3, 99)),
    "Aeva": ("<ffffflBf", (0.5, -3.25, -7, 2, 0.75)),
    "Ouster": ("<ffffIHHH", (0.5, 4_000_000_000, 60_000, 127, 9)),
    "Velodyne": ("<ffffHf", (0.5, 15, 0.25)),
}
EARLY_AEVA = ("<ffffflB", (0.5, -3.25, -7, 2))
EAST, NORTH = 350552.0308, 4041000.71


def encode(sensor, points, early=False):
    form, rest = EARLY_AEVA if early else PACKED[sensor]
    return b"".join(struct.pack(form, *map(float, point), *rest) for point in points)


def write_sequence(root, sensor, count=4, start=START, early=False, quaternion=(0, 0, 0, 1)):
    """One scan every 100 ms with a pose each, driving east at 10 m/s."""
    scans = root / "LiDAR" / sensor
    scans.mkdir(parents=True)
    lines = []
    for k in range(count):
        stamp = start + k * 100_000_000
        (scans / f"{stamp}.bin").write_bytes(encode(sensor, [(5, 1, -1), (0, 0, 0)], early))
        lines.append(f"{stamp} {EAST + k!r} {NORTH!r} 30.0 " + " ".join(map(str, quaternion)))
    (root / "LiDAR_GT").mkdir(exist_ok=True)
    (root / "LiDAR_GT" / f"global_{sensor}_gt.txt").write_text("\n".join(lines) + "\n")
    return root


@pytest.mark.parametrize("sensor", SENSORS)
@SAME_FOLDER
@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 30), st.just(3)),
        elements=st.floats(-300, 300, width=32),
    )
)
def test_points_are_read_back_from_every_sensors_records(tmp_path, sensor, points):
    path = tmp_path / f"{LATER}.bin"
    path.write_bytes(encode(sensor, points))
    present = points[(points != 0).any(axis=1)]
    if len(present):
        np.testing.assert_array_equal(read_scan(path, f"helipr_{sensor.lower()}"), present)
    else:
        with pytest.raises(BrokenScanError, match="all missing returns"):
            read_scan(path, f"helipr_{sensor.lower()}")
    path.write_bytes(encode(sensor, points)[:-1])
    with pytest.raises(BrokenScanError, match="expected a multiple of"):
        read_scan(path, f"helipr_{sensor.lower()}")


@pytest.mark.parametrize("name", ["{stamp}", "{number:06d}"])
@pytest.mark.parametrize("early", [False, True])
def test_the_aevas_intensity_appears_after_a_time(tmp_path, name, early):
    """Told by the stamp; of a file by another name, by its size."""
    points = np.arange(1, 31, dtype=np.float32).reshape(10, 3)
    stamp = AEVA_WITHOUT_INTENSITY + (0 if early else 1)
    path = tmp_path / (name.format(stamp=stamp, number=7) + ".bin")
    path.write_bytes(encode("Aeva", points, early))
    np.testing.assert_array_equal(read_helipr_scan(path, "Aeva"), points)
    # The misreading: of 725 bytes both records make whole numbers, but other points.
    both = np.arange(1, 88, dtype=np.float32).reshape(29, 3)
    path.write_bytes(encode("Aeva", both[:29] if early else both[:25], early))
    assert path.stat().st_size == 725
    if name == "{stamp}":
        assert len(read_helipr_scan(path, "Aeva")) == (29 if early else 25)


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_sequence_is_a_session_for_each_of_its_sensors(tmp_path, sensor):
    early = sensor == "Aeva"
    turn = Rotation.from_euler("z", 90, degrees=True).as_quat()
    root = write_sequence(tmp_path / "KAIST05", sensor, early=early, quaternion=turn)
    name = f"KAIST05_{sensor}"
    assert detect_format(tmp_path) == detect_format(root) == "helipr"
    for folder in (tmp_path, root):
        assert list_sessions("helipr", folder) == [name]
        session = open_session("helipr", folder)
        assert (session.name, len(session)) == (name, 4)
    np.testing.assert_array_equal(session.stamps, START + np.arange(4) * 100_000_000)
    np.testing.assert_allclose(session.positions, [[EAST + k, NORTH] for k in range(4)], atol=1e-6)
    np.testing.assert_array_equal(session.ground_truth, session.positions)
    np.testing.assert_allclose(yaw_of(session.poses), np.pi / 2)
    np.testing.assert_array_equal(session.points(0), [[5, 1, -1]])
    here = pose_from(session.poses[1, :3, :3], session.poses[1, :3, 3]) @ [5, 1, -1, 1]
    np.testing.assert_allclose(here[:3], [EAST + 1 - 1, NORTH + 5, 29], atol=1e-6)
    assert session.ground_z == SENSORS[sensor].ground_z
    assert session.decoding == f"helipr {sensor}"
    file = session.files[0]
    np.testing.assert_array_equal(read_scan(file, f"helipr_{sensor.lower()}"), session.points(0))


def test_a_sequence_of_several_sensors_is_no_mulran_folder(tmp_path):
    for sensor in ("Ouster", "Avia"):
        write_sequence(tmp_path / "Town01", sensor)
    write_sequence(tmp_path / "Town02", "Ouster")
    assert detect_format(tmp_path) == "helipr"
    names = ["Town01_Avia", "Town01_Ouster", "Town02_Ouster"]
    assert list_sessions("helipr", tmp_path) == names
    with pytest.raises(DeepringError, match="looks like a HeLiPR folder: use format helipr"):
        list_sessions("mulran", tmp_path)
    with pytest.raises(
        DeepringError, match=r"no session 'Town02_Avia' in .*, expected one of Town01"
    ):
        open_session("helipr", tmp_path, "Town02_Avia")


def test_scans_between_poses_are_interpolated_and_those_beyond_left_out(tmp_path):
    root = write_sequence(tmp_path / "Town01", "Velodyne")
    scans = root / "LiDAR" / "Velodyne"
    for after in (150_000_000, 10**10):
        (scans / f"{START + after}.bin").write_bytes(encode("Velodyne", [(1, 1, 1)]))
    (scans / f"{START + 1}.bin").write_bytes(b"short")
    session = open_session("helipr", tmp_path)
    assert len(session) == 5
    assert session.positions[2, 0] == pytest.approx(EAST + 1.5, abs=1e-6)
    assert session.skipped.without_pose == 1
    assert len(session.skipped.broken) == 1
    # Poses come at 10 Hz: half of that is none for a scan between two of them.
    assert len(open_session("helipr", tmp_path, pose_tolerance=0.04)) == 4


def test_poses_that_begin_at_zero_in_each_sequence_are_not_taken(tmp_path):
    root = write_sequence(tmp_path / "Town01", "Avia")
    truth = root / "LiDAR_GT" / "global_Avia_gt.txt"
    truth.rename(truth.with_name("Avia_gt.txt"))
    with pytest.raises(DeepringError, match=r"no global_Avia_gt\.txt in .*poses of session"):
        open_session("helipr", tmp_path)
    truth.write_text(f"{START} 1 2 3 0 0 0\n")
    with pytest.raises(DeepringError, match=r"global_Avia_gt\.txt: line 1 .*qx qy qz qw"):
        open_session("helipr", tmp_path)


@pytest.mark.parametrize(
    ("name", "count", "width"),
    [("avia_000000", 12320, 36), ("avia_000010", 12318, 36), ("aeva_000000", 68301, 61)],
)
def test_real_scans(name, count, width):
    sensor = name.partition("_")[0].capitalize()
    points = read_helipr_scan(real_data("other_sensors", f"helipr_{name}.bin"), sensor)
    assert points.shape == (count, 3)
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    assert np.percentile(np.abs(azimuth), 99) < width  # the sensor looks along x
    # Ahead of the car most low points are ground, near the height that the reader gives: the Aeva
    # looks 2° up, so that its ground falls.
    reach = np.hypot(points[:, 0], points[:, 1])
    ahead = points[(reach > 4) & (reach < 15) & (np.abs(points[:, 1]) < 3)]
    counts, edges = np.histogram(ahead[:, 2], np.arange(-4, 2, 0.1))
    assert edges[counts.argmax()] == pytest.approx(SENSORS[sensor].ground_z, abs=0.4)
