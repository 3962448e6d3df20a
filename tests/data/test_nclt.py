import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from deepring.core.rigid import yaw_of
from deepring.data.readers import open_session
from deepring.data.readers.nclt import list_nclt, open_nclt, read_ground_truth, read_nclt_scan
from deepring.errors import BrokenScanError, DeepringError
from helpers.real_data import real_data

DATE = "2012-02-04"
START = 1328398800000000  # microseconds
SAME_FOLDER = settings(
    deadline=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def encode(raw):
    """Raw rows x, y, z, intensity, laser to the bytes of a file."""
    return b"".join(struct.pack("<HHHBB", *map(int, row)) for row in raw)


def raw(metres):
    """The uint16 of a coordinate in the file's own axes."""
    return round((metres + 100) / 0.005)


def write_drive(scans, truth, count=5, rows=()):
    """One scan every 200 ms; poses every 10 ms that drive north at 2 m/s, heading north-east."""
    scans.mkdir(parents=True)
    truth.parent.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        point = (raw(10), raw(4), raw(-2), 7, 31)
        (scans / f"{START + i * 200_000}.bin").write_bytes(encode([point]))
    lines = [
        f"{START + t * 10_000},{0.02 * t!r},{30.0!r},{-1.0!r},0.0,0.0,{np.pi / 4!r}"
        for t in range(20 * count)
    ]
    truth.write_text("\n".join([*rows, *lines]) + "\n")


@SAME_FOLDER
@given(
    hnp.arrays(np.uint16, st.tuples(st.integers(1, 40), st.just(3))),
    st.integers(0, 255),
    st.integers(0, 31),
)
def test_decoding_inverts_encoding(tmp_path, values, intensity, laser):
    path = tmp_path / "1.bin"
    path.write_bytes(encode([(*xyz, intensity, laser) for xyz in values]))
    points = read_nclt_scan(path)
    assert points.dtype == np.float32
    zeros = (values == 0).all(axis=1)
    assert np.isnan(points[zeros]).all()
    there = np.rint((points[~zeros] * [1, -1, -1] + 100) / 0.005)
    np.testing.assert_array_equal(there, values[~zeros])


@SAME_FOLDER
@given(st.binary(max_size=64))
def test_any_bytes_decode_or_are_a_broken_scan(tmp_path, data):
    path = tmp_path / "1.bin"
    path.write_bytes(data)
    if data and len(data) % 8 == 0:
        assert read_nclt_scan(path).shape == (len(data) // 8, 3)
    else:
        with pytest.raises(BrokenScanError, match=rf"1\.bin: {len(data)} bytes.*expected"):
            read_nclt_scan(path)


def test_a_missing_file_is_a_broken_scan(tmp_path):
    with pytest.raises(BrokenScanError, match=r"none\.bin: cannot be read"):
        read_nclt_scan(tmp_path / "none.bin")


def test_coordinates_are_unsigned(tmp_path):
    path = tmp_path / "1.bin"
    path.write_bytes(encode([(raw(70), raw(0), raw(0), 0, 0)]))
    assert read_nclt_scan(path)[0, 0] == pytest.approx(70, abs=1e-4)
    # The misreading: int16 throws a point 70 m ahead to 258 m behind.
    assert np.fromfile(path, "<i2")[0] * 0.005 - 100 == pytest.approx(-257.68)


def test_both_y_and_z_change_sign(tmp_path):
    """A point ahead, to the right and below in the file is ahead, right and below here."""
    path = tmp_path / "1.bin"
    path.write_bytes(encode([(raw(10), raw(4), raw(2), 0, 0)]))
    np.testing.assert_allclose(read_nclt_scan(path)[0], [10, -4, -2], atol=1e-4)


def test_a_left_turn_is_counter_clockwise(tmp_path):
    path = tmp_path / "groundtruth.csv"
    path.write_text(f"{START},0,0,0,0,0,0\n{START + 10_000},0,0,0,0,0,-0.5\n")  # NED: - is left
    down = read_ground_truth(path).poses[1]
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    assert yaw_of(flip @ down @ flip) == pytest.approx(0.5)
    # The misreading: flipping z alone leaves a left-handed frame, where left stays clockwise.
    flip_z = np.diag([1.0, 1.0, -1.0, 1.0])
    assert yaw_of(flip_z @ down @ flip_z) == pytest.approx(-0.5)


def test_poses_carry_the_points_to_where_they_were(tmp_path):
    """World coordinates of a point agree with the file's own, computed there and flipped last."""
    write_drive(
        tmp_path / DATE / "velodyne_sync", tmp_path / "ground_truth" / f"groundtruth_{DATE}.csv"
    )
    session = open_nclt(tmp_path, DATE)
    i = 2
    here = session.poses[i, :3, :3] @ session.points(i)[0] + session.poses[i, :3, 3]
    c = np.sqrt(0.5)
    north, east, down = 0.8 + c * 10 - c * 4, 30 + c * 10 + c * 4, -1.0 - 2.0
    np.testing.assert_allclose(here, [north, -east, -down], atol=1e-4)
    np.testing.assert_allclose(session.ground_truth[i], [0.8, 30.0])
    np.testing.assert_allclose(session.positions[i], [0.8, -30.0])
    assert session.poses.dtype == session.ground_truth.dtype == np.float64


@pytest.mark.parametrize(
    ("scans", "truth"),
    [
        ("{d}/velodyne_sync", "ground_truth"),
        ("{d}/velodyne_data/velodyne_sync", "{d}/ground_truth"),
        ("velodyne_data/{d}/velodyne_sync", "ground_truth"),
        ("{d}_vel/{d}/velodyne_sync", "ground_truth"),
        ("{d}/velodyne_sync", "{d}"),
        ("{d}/velodyne_sync", "."),
        ("{d}_vel/{d}/velodyne_sync", "{d}_vel/{d}"),
    ],
)
def test_every_layout_opens(tmp_path, scans, truth):
    truth_file = tmp_path / truth.format(d=DATE) / f"groundtruth_{DATE}.csv"
    write_drive(tmp_path / scans.format(d=DATE), truth_file)
    assert list_nclt(tmp_path) == [DATE]
    session = open_nclt(tmp_path, DATE)
    assert len(session) == 5
    assert session.name == DATE
    np.testing.assert_array_equal(
        session.stamps, (START + np.arange(5) * 200_000) * 1000
    )  # nanoseconds


def test_the_drive_itself_may_be_the_root(tmp_path, monkeypatch):
    drive = tmp_path / DATE
    write_drive(drive / "velodyne_sync", tmp_path / "ground_truth" / f"groundtruth_{DATE}.csv")
    assert list_nclt(drive) == [DATE]
    assert len(open_nclt(drive, DATE)) == 5
    monkeypatch.chdir(drive)
    assert len(open_nclt(".", DATE)) == 5
    assert len(open_nclt("velodyne_sync/..", DATE)) == 5


def test_the_first_row_is_a_pose_and_no_header(tmp_path):
    truth = tmp_path / f"groundtruth_{DATE}.csv"
    write_drive(tmp_path / DATE / "velodyne_sync", truth)
    session = open_nclt(tmp_path, DATE)
    assert session.stamps[0] == START * 1000  # the scan at the first row's stamp has its pose
    # The misreading: without its first row the first scan has none.
    truth.write_text("\n".join(truth.read_text().splitlines()[1:]))
    assert open_nclt(tmp_path, DATE).skipped.without_pose == 1


def test_a_header_row_is_refused_with_its_file(tmp_path):
    truth = tmp_path / f"groundtruth_{DATE}.csv"
    write_drive(tmp_path / DATE / "velodyne_sync", truth, rows=["utime,x,y,z,r,p,h"])
    with pytest.raises(DeepringError, match=rf"groundtruth_{DATE}\.csv: .*no header"):
        open_nclt(tmp_path, DATE)


def test_nan_rows_are_dropped_and_counted(tmp_path):
    rows = [f"{START - 20_000}" + ", NaN" * 6, f"{START - 10_000}" + ", inf" * 6]
    truth = tmp_path / f"groundtruth_{DATE}.csv"
    write_drive(tmp_path / DATE / "velodyne_sync", truth, rows=rows)
    session = open_nclt(tmp_path, DATE)
    assert session.skipped.bad_poses == 2
    assert np.isfinite(session.poses).all()


def test_stamps_are_microseconds(tmp_path):
    """A scan 60 ms behind the last 10 ms of poses is refused at a tolerance of 50 ms."""
    scans = tmp_path / DATE / "velodyne_sync"
    write_drive(scans, tmp_path / f"groundtruth_{DATE}.csv", count=2)
    last_pose = START + 39 * 10_000
    (scans / f"{last_pose + 60_000}.bin").write_bytes(encode([(0, 0, 0, 0, 0)]))
    session = open_nclt(tmp_path, DATE)
    assert len(session) == 2
    assert session.skipped.without_pose == 1
    # The misreading: a tolerance of 50 ms in nanoseconds, held against microseconds, is 50 s.
    assert 60_000 < 0.05 * 1e9


def test_broken_files_are_listed_and_left_out(tmp_path):
    scans = tmp_path / DATE / "velodyne_sync"
    write_drive(scans, tmp_path / f"groundtruth_{DATE}.csv")
    (scans / f"{START + 1}.bin").write_bytes(b"")
    (scans / f"{START + 2}.bin").write_bytes(b"123456789")
    (scans / "notes.bin").write_bytes(b"12345678")
    (scans / f"{'9' * 25}.bin").write_bytes(b"12345678")
    (scans / f"._{START}.bin").write_bytes(b"12345678")
    (scans / f"{START + 3}.bin").symlink_to(scans / "nowhere")
    session = open_nclt(tmp_path, DATE)
    assert len(session) == 5
    text = "\n".join(session.skipped.broken)
    assert len(session.skipped.broken) == 5
    for reason in ("empty file", "9 bytes", "notes.bin: the name", "cannot be read"):
        assert reason in text


def test_all_broken_or_no_scans_is_an_error(tmp_path):
    scans = tmp_path / DATE / "velodyne_sync"
    write_drive(scans, tmp_path / f"groundtruth_{DATE}.csv", count=2)
    for file in scans.iterdir():
        file.write_bytes(b"")
    with pytest.raises(DeepringError, match=r"all 2 scans .* are broken .*empty"):
        open_nclt(tmp_path, DATE)
    for file in scans.iterdir():
        file.unlink()
    with pytest.raises(DeepringError, match=r"velodyne_sync contains no \.bin file"):
        open_nclt(tmp_path, DATE)


def test_no_ground_truth_and_other_dates_are_errors(tmp_path):
    truth = tmp_path / f"groundtruth_{DATE}.csv"
    write_drive(tmp_path / DATE / "velodyne_sync", truth)
    with pytest.raises(DeepringError, match=r"no scans of session '2013-01-01'"):
        open_nclt(tmp_path, "2013-01-01")
    truth.unlink()
    with pytest.raises(DeepringError, match=rf"no groundtruth_{DATE}\.csv"):
        open_nclt(tmp_path, DATE)


def test_a_folder_of_another_data_set_is_named(tmp_path):
    (tmp_path / "Sejong01" / "Ouster").mkdir(parents=True)
    with pytest.raises(
        DeepringError, match="looks like a MulRan folder: use format mulran"
    ) as caught:
        open_session("nclt", tmp_path, DATE)
    assert "<date>_vel/<date>/velodyne_sync/<utime>.bin" in str(caught.value)


def test_a_root_that_does_not_exist_is_an_error(tmp_path):
    with pytest.raises(DeepringError, match="none does not exist"):
        open_nclt(tmp_path / "none", DATE)


@pytest.mark.parametrize(("name", "count"), [("1326652795280148", 23546), ("disco_test", 26941)])
def test_real_scans(name, count):
    points = read_nclt_scan(real_data("nclt_scans", f"{name}.bin"))
    assert points.shape == (count, 3)
    assert np.abs(points).max() < 100
    assert points[:, 0].max() > 63.8  # int16 would have thrown these away
    # The densest layer is the ground: near the body origin's height, 0.96 m below the sensor.
    counts, edges = np.histogram(points[:, 2], np.arange(-5, 20, 0.1))
    ground = edges[counts.argmax()]
    assert -0.1 <= ground < 0.3
    # Upright structures rise above it, and nothing sinks as far below.
    assert np.percentile(points[:, 2], 99) > ground + 5
    assert np.percentile(points[:, 2], 1) > ground - 3
