"""Custom drives against the KITTI reader, and in whatever axes they were stored."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.inspection.check import check
from deepring.data.readers import detect_format, ground_of, list_sessions, open_session
from deepring.data.readers.custom import list_custom, open_custom
from deepring.data.readers.custom.custom_scans import UP
from deepring.data.readers.kitti import open_kitti
from deepring.errors import DeepringError
from deepring.rasters import BevRaster

# LiDAR to camera with a lever arm and, as real calibrations have it, a slight tilt.
TILT = rotation_from_rpy(0.01, -0.02, 0.015)
TR = pose_from(TILT @ [[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0.01, -0.07, -0.27])
KITTI = {
    "scans": "velodyne",
    "format": "kitti",
    "poses": "poses.txt",
    "sensor_in_body": "calib.txt",
    "world_up": "sensor",
    "sensor_height": 1.73,
}


def row(pose):
    return " ".join(repr(float(v)) for v in np.asarray(pose)[:3].ravel())


def drive_of(count=5):
    """World <- LiDAR poses of a turn uphill, z up, that do not begin at the origin."""
    i = np.arange(count)
    turns = rotation_from_rpy(0.02 * i, -0.03 * i, 0.3 + 0.1 * i)
    return pose_from(turns, np.stack([7 + i, 0.05 * i**2, 0.1 * i], axis=-1))


def scan_of(k, n=400):
    return np.random.default_rng(k).normal([3, 1, 0.5], [20, 9, 2], (n, 3)).astype(np.float32)


def write_kitti(root, poses, tr=TR):
    """A drive in KITTI's layout: poses of the camera, in the frame of the first camera."""
    (root / "velodyne").mkdir(parents=True)
    for k in range(len(poses)):
        values = np.column_stack([scan_of(k), np.ones(400)])
        values[:2, :3] = 0  # missing returns
        values.astype("<f4").tofile(root / "velodyne" / f"{k:06d}.bin")
    camera = tr @ poses @ np.linalg.inv(tr)
    (root / "poses.txt").write_text("".join(row(pose) + "\n" for pose in camera))
    (root / "calib.txt").write_text(f"P0: {row(np.eye(4))}\nTr: {row(tr)}\n")
    return root


def describe(root, **values):
    path = root / "drive.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return path


def write_custom(root, truth, up="z", world_up="z", to_body=None, **values):
    """The drive of z-up poses ``truth`` and their scans, stored in other axes."""
    to_body = np.eye(4) if to_body is None else to_body
    sensor, world = (pose_from(UP[axis], np.zeros(3)) for axis in (up, world_up))
    (root / "scans").mkdir(parents=True)
    for k in range(len(truth)):
        points = scan_of(k) @ UP[up].astype(np.float32)
        np.save(root / "scans" / f"{k}.npy", points)
    in_body = to_body @ sensor  # the pose of the sensor's stored axes in the body
    body = world.T @ truth @ sensor @ np.linalg.inv(in_body)
    (root / "poses.txt").write_text("".join(row(pose) + "\n" for pose in body))
    usual = {"scans": "scans", "poses": "poses.txt", "sensor_height": 1.5, "up": up}
    usual |= {"world_up": world_up, "sensor_in_body": in_body.tolist()}
    return describe(root, **(usual | values))


def test_a_kitti_sequence_is_what_the_kitti_reader_says(tmp_path):
    root = write_kitti(tmp_path / "seq", drive_of())
    custom, kitti = open_custom(describe(root, **KITTI)), open_kitti(root)
    assert custom.files == kitti.files
    np.testing.assert_allclose(custom.poses, kitti.poses, rtol=0, atol=1e-9)
    np.testing.assert_allclose(custom.ground_truth, kitti.ground_truth, rtol=0, atol=1e-9)
    for k in range(len(kitti)):
        np.testing.assert_array_equal(custom.points(k), kitti.points(k))
    assert custom.stamps is None
    assert ground_of(custom, "custom") == ground_of(kitti, "kitti") == -1.73


def test_kittis_world_by_its_axis_differs_by_one_fixed_motion(tmp_path):
    root = write_kitti(tmp_path / "seq", drive_of())
    custom = open_custom(describe(root, **KITTI | {"world_up": "-y"}))
    apart = custom.poses @ np.linalg.inv(open_kitti(root).poses)
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0], apart.shape), atol=1e-9)
    assert apart[0, 2, 2] > 0.99  # z is up in both, but for the calibration's tilt
    # The misreadings: without an axis the drive lies on its side; without the sensor's pose the
    # scans are taken for the camera's; and with the wrong sign it is upside down.
    for wrong, tilt in (
        ({"world_up": "z"}, "8[4-9]|9[0-6]"),
        ({"world_up": "-y", "sensor_in_body": None}, "8[4-9]|9[0-6]"),
        ({"world_up": "y"}, "1[678][0-9]"),
    ):
        with pytest.raises(DeepringError, match=rf"tilted by ({tilt})°"):
            open_custom(describe(root, **KITTI | wrong))


@pytest.mark.parametrize("up", UP)
@pytest.mark.parametrize("world_up", ["z", "-y", "x", "-z"])
def test_the_axes_that_a_drive_was_stored_in_do_not_matter(up, world_up, tmp_path):
    poses, lever = drive_of(3), pose_from(rotation_from_rpy(0.1, 0.2, 2.0), [1, -2, 0.5])
    session = open_custom(write_custom(tmp_path / "a", poses, up, world_up, lever))
    np.testing.assert_allclose(session.poses, poses, rtol=0, atol=1e-9)
    raster = BevRaster()
    for k in range(3):
        np.testing.assert_array_equal(session.points(k), scan_of(k))
        np.testing.assert_array_equal(raster(session.points(k), -1.5), raster(scan_of(k), -1.5))


@pytest.mark.parametrize("up", ["x", "-y", "-z"])
def test_scans_and_poses_turn_together(up, tmp_path):
    """A landmark stays where it is in the world; turned alone, the scans would carry it off."""
    poses = drive_of(3)
    session = open_custom(write_custom(tmp_path / "a", poses, up))
    stored = [np.load(file) for file in session.files]
    for k in range(3):
        place = poses[k, :3, :3] @ scan_of(k)[5] + poses[k, :3, 3]
        rotation, at = session.poses[k, :3, :3], session.poses[k, :3, 3]
        np.testing.assert_allclose(rotation @ session.points(k)[5] + at, place, atol=1e-5)
        assert np.abs(rotation @ stored[k][5] + at - place).max() > 0.1


def tum_row(stamp, pose):
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return " ".join(map(repr, [stamp, *pose[:3, 3].tolist(), *quaternion.tolist()]))


def test_tum_rows_are_the_same_poses_with_stamps(tmp_path):
    poses = drive_of()
    path = write_custom(tmp_path / "a", poses, pose_format="tum", poses="tum.txt")
    lines = [tum_row(100 + 0.5 * k, pose) for k, pose in enumerate(poses)]
    (tmp_path / "a" / "tum.txt").write_text("# stamp x y z qx qy qz qw\n" + "\n".join(lines))
    session = open_custom(path)
    np.testing.assert_allclose(session.poses, poses, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(session.stamps, (200 + np.arange(5)) * 500_000_000)

    # Read with w first, the quaternion is another rotation: that convention is not TUM's.
    wxyz = Rotation.from_quat(np.roll(Rotation.from_matrix(poses[:, :3, :3]).as_quat(), 1, axis=1))
    assert np.abs(wxyz.as_matrix() - session.poses[:, :3, :3]).max() > 0.1
    for text, words in (
        ("\n".join(lines[::-1]), "ascending order"),
        ("\n".join([*lines[:4], "103 0 0 0 0 0 0 0"]), "pose 5 of 5 is not rigid"),
        ("\n".join([*lines[:4], "103 0 0 0 nan 0 0 1"]), "pose 5 of 5"),
        ("\n".join([*lines[:4], "nan 0 0 0 0 0 0 1"]), "line 5 .*no number of seconds"),
        ("1 2 3", "stamp x y z qx qy qz qw"),
    ):
        (tmp_path / "a" / "tum.txt").write_text(text)
        with pytest.raises(DeepringError, match=rf"tum\.txt: .*{words}"):
            open_custom(path)


def test_numbers_in_names_count_as_numbers(tmp_path):
    poses = drive_of(11)
    session = open_custom(write_custom(tmp_path / "a", poses))  # 10.npy comes last, not after 1.npy
    assert [file.stem for file in session.files] == [str(k) for k in range(11)]
    for old, new in ((9, "1.9"), (10, "1.95")):  # stamps in seconds, no trailing zeros
        (tmp_path / "a" / "scans" / f"{old}.npy").rename(tmp_path / "a" / "scans" / f"{new}.npy")
    names = [file.stem for file in open_custom(tmp_path / "a" / "drive.yaml").files]
    assert names[1:4] == ["1", "1.9", "1.95"]


def test_scans_without_poses_are_an_error_with_both_counts(tmp_path):
    path = write_custom(tmp_path / "a", drive_of(4))
    (tmp_path / "a" / "scans" / "2.npy").unlink()
    (tmp_path / "a" / "scans" / "._0.npy").write_bytes(b"hidden, no scan")
    with pytest.raises(DeepringError, match=r"drive\.yaml: 3 scans in .*, but 4 poses in "):
        open_custom(path)


def test_broken_files_keep_the_others_on_their_rows(tmp_path):
    root = write_kitti(tmp_path / "seq", drive_of())
    (root / "velodyne" / "000001.bin").write_bytes(b"")
    (root / "velodyne" / "000003.bin").write_bytes(bytes(17))
    custom, kitti = open_custom(describe(root, **KITTI)), open_kitti(root)
    assert custom.files == kitti.files
    np.testing.assert_allclose(custom.poses, kitti.poses, rtol=0, atol=1e-9)
    assert custom.skipped.broken == kitti.skipped.broken
    for file in (root / "velodyne").iterdir():
        file.write_bytes(b"")
    with pytest.raises(DeepringError, match=r"all 5 scans of .* are broken"):
        open_custom(root / "drive.yaml")


def test_one_file_may_describe_several_drives(tmp_path):
    for name in ("a", "b"):
        write_custom(tmp_path / name, drive_of(3 if name == "a" else 4))
    drives = {n: {"scans": f"{n}/scans", "poses": f"{n}/poses.txt"} for n in ("b", "a")}
    path = describe(
        tmp_path, sensor_height=1.5, drives=drives | {"c": {**drives["a"], "range": [1, 50]}}
    )
    assert detect_format(path) == "custom"
    assert list_custom(path) == list_sessions("custom", path) == ["b", "a", "c"]
    assert [len(open_session("custom", path, name)) for name in ("a", "b")] == [3, 4]
    with pytest.raises(DeepringError, match=r"3 sessions \(b, a, c\), expected the name of one"):
        open_session("custom", path)
    with pytest.raises(DeepringError, match="several drives, expected the name of one of b, a, c"):
        open_custom(path)
    with pytest.raises(DeepringError, match=r"no drive 'd', expected the name of one of b, a, c"):
        open_session("custom", path, "d")
    reports = check(path)
    assert [report.scans for report in reports] == [4, 3, 3]
    assert [report.readable for report in reports] == [4, 3, 3]


def test_a_folder_is_told_its_format(tmp_path):
    write_kitti(tmp_path, drive_of(1))
    (tmp_path / "empty").mkdir()
    with pytest.raises(DeepringError, match=r"no \.yaml or \.yml file.*use format kitti"):
        list_sessions("custom", tmp_path)
    with pytest.raises(DeepringError, match="custom drives: "):
        detect_format(tmp_path / "empty")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scans": "nowhere"}, r"scans: .*nowhere is not a folder"),
        ({"scans": "poses.txt"}, r"scans: .*poses\.txt is not a folder"),
        ({"scans": "a" * 5000}, "scans: .* is not a folder"),
        ({"scans": "a\0b"}, "scans: .* is not a folder"),
        ({"scans": "."}, "without scans"),
        ({"poses": "none.txt"}, r"poses: .*none\.txt is not a file"),
        ({"poses": "scans"}, "poses: .*scans is not a file"),
        ({"poses": "bad.txt"}, r"bad\.txt: pose 2 of 3 is not rigid \(1 are not\)"),
        ({"poses": "words.txt"}, r"words\.txt: line 1 reads 'no poses at all'"),
        ({"pose_format": "tum"}, r"poses\.txt: .*pose_format: tum"),
    ],
)
def test_what_is_not_there_or_no_pose_is_named(changes, words, tmp_path):
    path = write_custom(tmp_path / "a", drive_of(3), **changes)
    lines = [row(pose) for pose in drive_of(3)]
    lines[1] = row(np.diag([1, 1, -1, 1]))  # a mirror is no rotation
    (tmp_path / "a" / "bad.txt").write_text("\n".join(lines))
    (tmp_path / "a" / "words.txt").write_text("no poses at all")
    with pytest.raises(DeepringError, match=words):
        open_custom(path)


def test_bin_files_need_their_format(tmp_path):
    root = write_kitti(tmp_path, drive_of(1))
    with pytest.raises(DeepringError, match=r"format: missing, .*add one of .*kitti, mulran, nclt"):
        open_custom(describe(root, **{k: v for k, v in KITTI.items() if k != "format"}))
