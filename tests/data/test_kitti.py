import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.data.readers.kitti import list_kitti, open_kitti, read_calibration, read_kitti_scan
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError, DeepringError
from helpers.real_data import real_data

SAME_FOLDER = settings(
    deadline=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)

# LiDAR (x forward, y left, z up) to camera (x right, y down, z forward), with a lever arm.
TR = pose_from([[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0.01, -0.07, -0.27])
IDENTITY = np.eye(4)


def row(pose):
    return " ".join(repr(float(v)) for v in np.asarray(pose)[:3].ravel())


def lidar_poses(count):
    """A left turn: the LiDAR's poses in the frame of its first scan."""
    i = np.arange(count)
    zero = np.zeros(count)
    return pose_from(rotation_from_rpy(zero, zero, 0.1 * i), np.stack([i, 0.05 * i**2, zero], -1))


def write_drive(drive, tr=TR, count=4, poses="poses.txt", times=True):
    (drive / "velodyne").mkdir(parents=True)
    for i in range(count):
        np.array([[i + 1, 2, 3, 0.5]], "<f4").tofile(drive / "velodyne" / f"{i:06d}.bin")
    path = drive / poses
    path.parent.mkdir(exist_ok=True)
    camera = tr @ lidar_poses(count) @ np.linalg.inv(tr)
    path.write_text("\n".join(row(p) for p in camera) + "\n")
    lines = [f"P{i}: {row(np.eye(4))}" for i in range(4)] + [f"Tr: {row(tr)}"]
    (drive / "calib.txt").write_text("\n".join(lines) + "\n")
    if times:
        (drive / "times.txt").write_text("".join(f"{0.1 * i:.6e}\n" for i in range(count)))
    return drive


def test_lidar_poses_are_in_the_frame_of_the_first_scan(tmp_path):
    session = open_kitti(write_drive(tmp_path / "drive"))
    np.testing.assert_allclose(session.poses, lidar_poses(4), atol=1e-12)
    np.testing.assert_array_equal(session.ground_truth, session.poses[:, :2, 3])
    assert yaw_of(session.poses[1]) == pytest.approx(0.1)  # left is counter-clockwise
    np.testing.assert_array_equal(session.stamps, np.arange(4) * 100_000_000)
    np.testing.assert_array_equal(session.points(2), [[3, 2, 3]])
    # The misreading: taking the camera's poses as they stand lays the drive on its side.
    camera = TR @ lidar_poses(4) @ np.linalg.inv(TR)
    assert abs(camera[3, 0, 3] - session.poses[3, 0, 3]) > 1


def test_identity_tr_gives_poses_as_they_stand(tmp_path):
    drive = write_drive(tmp_path / "drive", tr=IDENTITY, times=False)
    session = open_kitti(drive)
    np.testing.assert_array_equal(session.poses, lidar_poses(4))
    assert session.stamps is None
    assert session.name == "drive"


@pytest.mark.parametrize(
    ("drive", "poses", "root", "sequence"),
    [
        ("sequences/00", "poses.txt", ".", "00"),
        ("sequences/00", "../../poses/00.txt", ".", "00"),
        ("sequences/00", "../../poses/00.txt", "sequences", "00"),
        ("sequences/00", "../../poses/00.txt", "sequences/00", None),
        ("sequences/00", "../../poses/00.txt", "sequences/00", "00"),
        ("dataset/sequences/00", "../../poses/00.txt", ".", "00"),
        ("dataset/sequences/00", "../../poses/00.txt", ".", "0"),
        ("00", "../poses/00.txt", ".", "00"),
        ("mine", "poses.txt", ".", "mine"),
        ("mine", "poses.txt", "mine", None),
    ],
)
def test_every_layout_opens(tmp_path, drive, poses, root, sequence):
    folder = tmp_path / drive
    folder.mkdir(parents=True)
    (folder / poses).resolve().parent.mkdir(exist_ok=True)
    write_drive(folder, poses=poses)
    session = open_kitti(tmp_path / root, sequence)
    assert len(session) == 4
    assert session.name == folder.name
    assert list_kitti(tmp_path / root) == [folder.name]


def test_test_sequences_without_poses_are_not_listed(tmp_path):
    write_drive(tmp_path / "sequences" / "10")
    for name in ("11", "12"):
        (tmp_path / "sequences" / name / "velodyne").mkdir(parents=True)
    (tmp_path / "sequences" / "12" / "poses.txt").touch()
    (tmp_path / "sequences" / "03" / "velodyne").mkdir(parents=True)
    assert list_kitti(tmp_path) == ["03", "10", "12"]


@pytest.mark.parametrize("text", [f"Tr: {row(TR)}\n", f"{row(TR)}\n", f"\nP0: 1\nTr : {row(TR)}"])
def test_tr_with_and_without_its_name(tmp_path, text):
    (tmp_path / "calib.txt").write_text(text)
    np.testing.assert_array_equal(read_calibration(tmp_path / "calib.txt"), TR)


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "P0: 1 0 0",
            "Tr: 1 2 3",
            "Tr: a b",
            f"{row(TR)}\n{row(TR)}",
            "Tr:" + " 0" * 12,
            "\xff",
        ),
        *("Tr: 1 0 0 1_0 0 1 0 0 0 0 1 0", "Tr: 1 0 0 ١ 0 1 0 0 0 0 1 0"),
    ],
)
def test_calibration_without_tr_is_an_error(tmp_path, text):
    (tmp_path / "calib.txt").write_bytes(text.encode("latin-1" if "\xff" in text else "utf-8"))
    with pytest.raises(DeepringError, match=r"calib\.txt: .*expected"):
        read_calibration(tmp_path / "calib.txt")


def test_no_calibration_says_what_to_write(tmp_path):
    drive = write_drive(tmp_path / "drive")
    (drive / "calib.txt").unlink()
    with pytest.raises(DeepringError, match="write: Tr: 1 0 0 0"):
        open_kitti(drive)


def test_names_are_rows_when_scans_are_missing(tmp_path):
    drive = write_drive(tmp_path / "drive")
    (drive / "velodyne" / "000001.bin").unlink()
    session = open_kitti(drive)
    np.testing.assert_allclose(session.poses, lidar_poses(4)[[0, 2, 3]], atol=1e-12)
    np.testing.assert_array_equal(session.stamps, np.array([0, 2, 3]) * 100_000_000)


def test_scans_beyond_the_poses_and_bad_rows_are_counted(tmp_path):
    drive = write_drive(tmp_path / "drive", times=False)
    lines = (drive / "poses.txt").read_text().splitlines()
    lines[1] = " ".join(["nan"] * 12)
    (drive / "poses.txt").write_text("\n".join(lines[:3]))
    (drive / "velodyne" / "000000.bin").write_bytes(b"")
    session = open_kitti(drive)
    assert [path.stem for path in session.files] == ["000002"]
    assert session.skipped.without_pose == 2
    assert session.skipped.bad_poses == 1
    assert len(session.skipped.broken) == 1


def test_as_many_scans_as_poses_numbered_from_one_is_an_error(tmp_path):
    drive = write_drive(tmp_path / "drive")
    (drive / "velodyne" / "000000.bin").rename(drive / "velodyne" / "000004.bin")
    with pytest.raises(DeepringError, match=r"numbered up to 4; expected names from 000000\.bin"):
        open_kitti(drive)


def test_no_scan_with_a_row_is_an_error(tmp_path):
    drive = write_drive(tmp_path / "drive", count=3)
    for i in range(2):
        (drive / "velodyne" / f"{i:06d}.bin").rename(drive / "velodyne" / f"{i + 700:06d}.bin")
    (drive / "velodyne" / "000002.bin").unlink()
    with pytest.raises(DeepringError, match=r"numbered 700 to 701, .* 3 rows"):
        open_kitti(drive)


@pytest.mark.parametrize("text", ["0.0\n0.1\n", "0\n1\n2\nnan\n", "", "a\n"])
def test_times_that_do_not_fit_are_an_error(tmp_path, text):
    drive = write_drive(tmp_path / "drive")
    (drive / "times.txt").write_text(text)
    with pytest.raises(DeepringError, match=r"times\.txt: "):
        open_kitti(drive)


def test_folders_without_what_is_needed_are_errors(tmp_path):
    with pytest.raises(DeepringError, match="no velodyne/ folder"):
        open_kitti(tmp_path)
    drive = write_drive(tmp_path / "sequences" / "00")
    with pytest.raises(DeepringError, match="expected one of 00"):
        open_kitti(tmp_path)
    with pytest.raises(DeepringError, match="no scans of session '07', expected one of 00"):
        open_kitti(tmp_path, "07")
    (drive / "poses.txt").unlink()
    with pytest.raises(DeepringError, match=r"no poses\.txt and no poses/NN\.txt"):
        open_kitti(tmp_path, "00")
    for file in (drive / "velodyne").iterdir():
        file.unlink()
    with pytest.raises(DeepringError, match=r"contains no \.bin file"):
        open_kitti(tmp_path, "00")


@SAME_FOLDER
@given(st.binary(max_size=160))
def test_any_bytes_decode_or_are_a_broken_scan(tmp_path, data):
    path = tmp_path / "000000.bin"
    path.write_bytes(data)
    values = np.frombuffer(data[: len(data) // 16 * 16], "<f4").reshape(-1, 4)[:, :3]
    values = values[np.isfinite(values).all(axis=1)]
    values = values[(values != 0).any(axis=1)]
    if len(data) % 16 == 0 and len(values):
        np.testing.assert_array_equal(read_scan(path, "kitti"), values)
    else:
        with pytest.raises(BrokenScanError, match=r"000000\.bin: \d+ (bytes|records).*expected"):
            read_scan(path, "kitti")


def test_real_drive():
    session = open_kitti(real_data("kitti00_south"))
    assert len(session) == 974
    assert session.stamps is None
    assert str(session.skipped) == ""
    steps = np.linalg.norm(np.diff(session.poses[:, :3, 3], axis=0), axis=1)
    assert np.median(steps) == pytest.approx(1.9, abs=0.2)
    # The car drives where it looks: x is forward.
    forward = session.poses[:-1, :2, 0]
    moved = np.diff(session.positions, axis=0)
    along = (forward * moved).sum(axis=1) / np.linalg.norm(moved, axis=1)
    assert np.median(along) > 0.99
    heights = session.points(100)[:, 2]
    counts, edges = np.histogram(heights, np.arange(-4, 4, 0.1))
    assert edges[counts.argmax()] == pytest.approx(-1.8, abs=0.3)


def test_real_scans_as_published():
    points = read_kitti_scan(real_data("kitti08_pair", "000720.bin"))
    assert points.shape == (2026576 // 16, 3)
    assert np.abs(points).max() < 130


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("P0: 1 0\nTr_velo_to_cam: 1 0 0\n", "has P0, Tr_velo_to_cam, but no Tr"),
        ("Tr: 1 0 0 0 0 1 0 0 0 0 1\n", "Tr is '1 0 0 0 0 1 0 0 0 0 1'; expected .*12 numbers"),
        ("Tr: 1,0,0,0,0,1,0,0,0,0,1,0\n", "separated by blanks"),
        ("", "has no Tr"),
        ("Tr: 1 0 0 0 0 -1 0 0 0 0 1 0\n", "its rotation mirrors"),
        ("Tr: 1.01 0 0 0 0 1.01 0 0 0 0 1.01 0\n", "lengths 1.01, 1.01, 1.01"),
    ],
)
def test_what_a_calibration_holds_instead_is_named(tmp_path, text, found):
    (tmp_path / "calib.txt").write_text(text)
    with pytest.raises(DeepringError, match=rf"calib\.txt: .*{found}"):
        read_calibration(tmp_path / "calib.txt")
