"""Pose files of every reader: marks and line ends, wrong tables, and poses that are none."""

from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.poses.pose_tables import read_table, stamped_rows
from deepring.data.readers import list_sessions, open_session
from deepring.errors import DeepringError, FileError
from deepring.localization.drives.trajectory_files import tum_lines

STAMP = 1691936557946849179  # not representable as seconds in float64
COUNT = 6
POSES = pose_from(
    rotation_from_rpy(0.01, -0.02, 0.3 * np.arange(COUNT)),
    np.stack(
        [345000.5 + np.arange(COUNT), 4037000 + 0.1 * np.arange(COUNT), 0 * np.arange(COUNT)], -1
    ),
)
STAMPS = STAMP + 100_000_007 * np.arange(COUNT)


def numbers(pose, separator=" "):
    return separator.join(repr(float(v)) for v in pose[:3].ravel())


def scans(folder, names):
    folder.mkdir(parents=True)
    for name in names:
        np.array([[5, 1, -1, 80]], "<f4").tofile(folder / f"{name}.bin")


def kitti(root, poses):
    scans(root / "velodyne", [f"{k:06d}" for k in range(COUNT)])
    (root / "poses.txt").write_text("".join(f"{numbers(p)}\n" for p in poses))
    (root / "calib.txt").write_text(f"P0: {numbers(np.eye(4))}\nTr: {numbers(np.eye(4))}\n")
    (root / "times.txt").write_text("".join(f"{s // 10**9}.{s % 10**9:09d}\n" for s in STAMPS))
    return "kitti", root


def mulran(root, poses):
    scans(root / "drive" / "Ouster", STAMPS)
    rows = [f"{s},{numbers(p, ',')}\n" for s, p in zip(STAMPS, poses, strict=True)]
    (root / "drive" / "global_pose.csv").write_text("".join(rows))
    return "mulran", root


def quaternion_row(pose):

    values = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
    return " ".join(repr(float(v)) for v in values)


def helipr(root, poses):
    folder = root / "drive" / "LiDAR" / "Avia"
    folder.mkdir(parents=True)
    for stamp in STAMPS:
        (folder / f"{stamp}.bin").write_bytes(np.array([5, 1, -1], "<f4").tobytes() + bytes(7))
    (root / "drive" / "LiDAR_GT").mkdir()
    rows = [f"{s} {quaternion_row(p)}\n" for s, p in zip(STAMPS, poses, strict=True)]
    (root / "drive" / "LiDAR_GT" / "global_Avia_gt.txt").write_text("".join(rows))
    return "helipr", root


def nclt(root, poses):
    scans(root / "2012-01-08" / "velodyne_sync", STAMPS // 1000)
    rows = [
        f"{s // 1000},{float(p[0, 3])!r},{float(-p[1, 3])!r},0.0,0.01,0.02,{-0.3 * k!r}\n"
        for k, (s, p) in enumerate(zip(STAMPS, poses, strict=True))
    ]
    (root / "2012-01-08" / "groundtruth_2012-01-08.csv").write_text("".join(rows))
    return "nclt", root


def tum(root, poses):
    scans(root / "scans", range(COUNT))
    (root / "drive.yaml").write_text(
        "scans: scans\nposes: drive.tum\npose_format: tum\nformat: kitti\nsensor_height: 1.7\n"
    )
    rows = [
        f"{s // 10**9}.{s % 10**9:09d} {quaternion_row(p)}\n"
        for s, p in zip(STAMPS, poses, strict=True)
    ]
    (root / "drive.tum").write_text("# stamp x y z qx qy qz qw\n" + "".join(rows))
    return "custom", root / "drive.yaml"


def custom(root, poses):
    scans(root / "scans", range(COUNT))
    (root / "calib.txt").write_text(f"Tr: {numbers(np.eye(4))}\n")
    (root / "drive.yaml").write_text(
        "scans: scans\nposes: poses.txt\nformat: kitti\nsensor_height: 1.7\n"
        "sensor_in_body: calib.txt\n"
    )
    (root / "poses.txt").write_text("".join(f"{numbers(p)}\n" for p in poses))
    return "custom", root / "drive.yaml"


KINDS = [kitti, mulran, helipr, nclt, tum, custom]


def opened(format, root):
    [name] = list_sessions(format, root)
    return open_session(format, root, name)


def text_files(root):
    return [p for p in sorted(root.rglob("*")) if p.suffix in (".txt", ".csv", ".tum", ".yaml")]


@pytest.mark.parametrize("write", KINDS)
@pytest.mark.parametrize(
    ("mark", "end"), [(b"\xef\xbb\xbf", "\n"), (b"", "\r\n"), (b"\xef\xbb\xbf", "\r")]
)
def test_marks_and_line_ends_change_nothing(tmp_path, write, mark, end):
    format, root = write(tmp_path, POSES)
    plain = opened(format, root)
    assert len(plain) >= COUNT - 1
    files = text_files(tmp_path)
    assert files
    for file in files:
        file.write_bytes(mark + file.read_text().replace("\n", end).encode())
    marked = opened(format, root)
    np.testing.assert_array_equal(marked.poses, plain.poses)
    np.testing.assert_array_equal(marked.stamps, plain.stamps)
    assert marked.skipped == plain.skipped


@pytest.mark.parametrize("write", KINDS)
def test_utf_16_is_refused_in_one_line(tmp_path, write):
    format, root = write(tmp_path, POSES)
    for file in text_files(tmp_path):
        content = file.read_bytes()
        for encoding in ("utf-16", "utf-16-le"):
            file.write_bytes(content.decode().encode(encoding))
            with pytest.raises(FileError, match=rf"{file.name}: is UTF-16 text") as caught:
                opened(format, root)
            assert "\n" not in str(caught.value)
        file.write_bytes(content)


@pytest.mark.parametrize("write", [kitti, tum])
def test_seconds_are_exact_nanoseconds(tmp_path, write):
    session = opened(*write(tmp_path, POSES))
    assert session.stamps.dtype == np.int64
    np.testing.assert_array_equal(session.stamps, STAMPS)


def test_a_trajectory_that_is_written_has_the_stamps_of_its_scans(tmp_path):
    format, root = tum(tmp_path, POSES)
    (tmp_path / "drive.tum").write_text("\n".join(tum_lines(POSES, STAMPS)))
    again = opened(format, root)
    np.testing.assert_array_equal(again.stamps, STAMPS)
    np.testing.assert_allclose(again.poses, POSES, atol=2e-9)


def scaled(poses, factor):
    poses = poses.copy()
    poses[:, :3, :3] *= factor
    return poses


@pytest.mark.parametrize("write", [kitti, mulran, helipr, tum, custom])
@pytest.mark.parametrize("factor", [1.004, 0.997])
def test_scaled_rotations_are_refused_in_every_reader(tmp_path, write, factor):
    if write in (tum, helipr):
        format, root = write(tmp_path, POSES)
        [file] = [f for f in text_files(tmp_path) if f.suffix != ".yaml"]
        rows = [line.split() for line in file.read_text().splitlines() if line[0] != "#"]
        wrong = [[*row[:4], *(repr(factor * float(q)) for q in row[4:])] for row in rows]
        file.write_text("\n".join(map(" ".join, wrong)))
    else:
        format, root = write(tmp_path, scaled(POSES, factor))
    with pytest.raises(DeepringError, match="length") as caught:
        opened(format, root)
    assert f"{factor:g}"[:5] in str(caught.value)


def test_a_scaled_calibration_is_refused(tmp_path):
    for write in (kitti, custom):
        format, root = write(tmp_path / write.__name__, POSES)
        wrong = scaled(np.eye(4)[None], 1.004)[0]
        (tmp_path / write.__name__ / "calib.txt").write_text(f"Tr: {numbers(wrong)}\n")
        with pytest.raises(DeepringError, match=r"Tr is .*lengths 1\.004"):
            opened(format, root)


ROW = "a stamp and 2 numbers"


@pytest.mark.parametrize(
    ("text", "delimiter", "reason"),
    [
        ("stamp,x,y\n1,2,3\n", ",", "line 1 reads 'stamp,x,y', a header"),
        ("stamp x y\n1 2 3\n", None, "line 1 reads 'stamp x y', a header"),
        ("stamp;x;y\n1;2;3\n", None, "a header"),
        ("1 2 3 4\n", None, "4 values instead of 3"),
        ("1 2 3\n1 2\n", None, "line 2 reads '1 2', 2 values instead of 3"),
        ("1,2,3\n", None, "separated by commas instead of blanks"),
        ("1, 2, 3\n", None, "separated by commas instead of blanks|'1,' is no whole number"),
        ("1;2;3\n", None, "separated by semicolons instead of blanks"),
        ("1;2;3\n", ",", "separated by semicolons instead of commas"),
        ("1 2 3\n", ",", "separated by blanks instead of commas"),
        ("1\t2\t3\n", ",", "separated by blanks instead of commas"),
        ("1 2,5 3,5\n", None, "'2,5' has a decimal comma"),
        ("1 2 x\n", None, "'x' is no number"),
        ("1.5 2 3\n", None, "'1.5' is no whole number"),
        ("1 2 3\nstamp x y\n", None, "line 2 .* is no whole number"),
        ("1 2 3 # comment\n\n# only a comment\n1 2\n", None, "line 4 reads '1 2'"),
        ("1,2,3\n\n  \n1,2,3\n", ",", "line 3 holds blanks alone"),
        ("", None, "contains no row"),
        ("# nothing\n", None, "contains no row"),
    ],
)
def test_the_first_wrong_row_and_its_fault_are_named(tmp_path, text, delimiter, reason):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(FileError, match=rf"poses\.txt: .*({reason}).*; expected .*{ROW}") as caught:
        read_table(path, stamped_rows(2), delimiter, ROW)
    assert "\n" not in str(caught.value)


def test_angles_in_degrees_are_refused(tmp_path):
    format, root = nclt(tmp_path, POSES)
    file = tmp_path / "2012-01-08" / "groundtruth_2012-01-08.csv"
    rows = [line.split(",") for line in file.read_text().splitlines()]
    degrees = [[*r[:4], *(repr(float(np.degrees(float(a)))) for a in r[4:])] for r in rows]
    file.write_text("\n".join(map(",".join, degrees)))
    with pytest.raises(DeepringError, match=r"beyond a whole turn.*radians, not degrees"):
        opened(format, root)


@settings(deadline=None, derandomize=True, max_examples=150)
@given(
    st.one_of(
        st.binary(max_size=60),
        st.text("0123456789.,;eE+- \t\n\r#naif", max_size=60).map(str.encode),
        st.lists(
            st.tuples(st.floats(), st.floats(), st.floats()).map(lambda r: " ".join(map(repr, r))),
            max_size=4,
        ).map(lambda rows: "\n".join(rows).encode()),
    ),
    st.booleans(),
)
def test_any_bytes_are_rows_or_a_file_error(tmp_path_factory, content, seconds):
    """What is read is what a plain reader of lines reads."""
    path = tmp_path_factory.mktemp("tables") / "poses.txt"
    path.write_bytes(content)
    try:
        rows = read_table(path, stamped_rows(2), None, ROW, seconds=seconds)
    except FileError:
        return
    lines = [line.partition("#")[0].split() for line in path.read_text("utf-8-sig").splitlines()]
    plain = [line for line in lines if line]
    for row, (stamp, *values) in zip(rows, plain, strict=True):
        unit = 10**9 if seconds else 1
        assert abs(int(row["stamp"]) - Decimal(stamp) * unit) <= Decimal("0.5")
        np.testing.assert_array_equal(row["values"], [float(v) for v in values])
