"""Wrong numbers are noticed and, where they can be, named; good scans of every sensor are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deepring.data.inspection.figures import measure_ground, measure_scan, median_figures
from deepring.data.inspection.scans import expect_coordinates, scan_findings
from deepring.data.inspection.session import SAMPLE, expect_usable, inspect
from deepring.data.inspection.session_scans import (
    measure_scans,
    measured_findings,
    repeated_findings,
)
from deepring.data.readers import binary_formats, open_session
from deepring.data.readers.helipr import SENSORS
from deepring.data.readers.kitti import open_kitti
from deepring.data.readers.mulran import T_BASE_LIDAR
from deepring.data.scans.returns import scan_from
from deepring.data.session import Session
from deepring.data.spacing import sample_of
from deepring.errors import BrokenScanError, DataError
from helpers.real_data import real_data
from helpers.wrong_scans import DOUBTED, NAMED, WRONG, rows, whole_records, write_wrong

HEIGHT = -1.8  # z of the ground in MulRan's scans


@pytest.fixture(scope="module")
def street(tiny_mulran):
    """Points and poses of a simulated drive: 8 scans, some tens of metres apart."""
    session = open_session("mulran", tiny_mulran, "SimCity01")
    indices = np.linspace(0, len(session) - 1, 8).round().astype(int)
    poses = session.poses[indices].copy()
    poses[:, :2, 3] -= poses[0, :2, 3] + [100, -80]
    return [session.points(k) for k in indices], poses


def findings_of(session, ground_z):
    """Findings about all scans, without those about poses."""
    everything = range(len(session))
    measured = measure_scans(session, everything)
    return measured_findings(session, measured, ground_z) + repeated_findings(session, everything)


@pytest.mark.parametrize("kind", WRONG)
def test_every_wrong_kind_is_noticed(kind, street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", kind, *street))
    found = findings_of(session, HEIGHT)
    assert found
    assert any(finding.unusable for finding in found) == (kind not in DOUBTED)
    if kind in NAMED:
        assert NAMED[kind] in found[0].advice
    text = "\n".join(map(str, found))
    assert "nan" not in text.replace("nanoseconds", "")
    assert all(finding.advice for finding in found)


def test_the_same_scans_written_right_are_not_doubted(street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "right", *street))
    assert findings_of(session, HEIGHT) == []
    assert expect_usable(session, HEIGHT) == []


@pytest.mark.parametrize("off", [-170.0, -15.0, -1.5, 1.0, 1.8])  # of a slipped decimal, and less
def test_a_ground_elsewhere_is_doubted(off, street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "right", *street))
    (finding,) = inspect(session, HEIGHT + off)
    assert finding.subject == "ground"
    assert not finding.unusable
    assert f"{HEIGHT + off:.2f} m" in finding.found
    shown = float(finding.found.split("z = ")[1].split(" m")[0])
    assert shown == pytest.approx(HEIGHT, abs=0.2)


def test_unusable_drives_end_before_work_begins(street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "float64", *street))
    with pytest.raises(DataError, match=r"session drive cannot be used: scans: .*float64 with 4"):
        expect_usable(session, HEIGHT)


@pytest.mark.parametrize("name", ["tiny_nclt", "tiny_mulran"])
def test_simulated_drives_are_not_doubted(name, request):
    root, format = request.getfixturevalue(name), name.removeprefix("tiny_")
    ground_z = binary_formats()[format].ground_z
    for session_name in {"nclt": ["2031-02-04", "2031-03-17"]}.get(format, ["SimCity01"]):
        assert findings_of(open_session(format, root, session_name), ground_z) == []


def test_real_scans_of_every_sensor_are_not_doubted():
    formats = binary_formats()
    for folder, pattern, format, ground_z in [
        ("kitti08_pair", "*.bin", "kitti", -1.73),
        ("nclt_scans", "*.bin", "nclt", 0.0),
        ("other_sensors", "helipr_aeva_*.bin", "helipr_aeva", -1.81),
        ("other_sensors", "helipr_avia_*.bin", "helipr_avia", -1.67),
        ("other_sensors", "rellis_os1_64.bin", "kitti", -1.1),
        ("other_sensors", "rellis_vlp32c.bin", "kitti", -1.0),
    ]:
        for file in sorted(real_data(folder).glob(pattern)):
            assert scan_findings(formats[format].read(file), ground_z) == [], file


def test_a_real_drive_is_not_doubted():
    session = open_kitti(real_data("kitti00_south"))
    assert inspect(session, -1.73) == []
    figures = measure_scans(session, range(0, len(session), 5))
    assert measured_findings(session, figures, -1.73) == []


@pytest.mark.parametrize(
    ("file", "right", "wrong"),
    [
        ("nclt_scans/disco_test.bin", "nclt", "kitti"),
        ("kitti08_pair/000720.bin", "kitti", "nclt"),
        ("other_sensors/rellis_os1_64.bin", "kitti", "nclt"),
    ],
)
def test_a_real_scan_under_the_name_of_another_format_is_refused(file, right, wrong, tmp_path):
    content = real_data(*file.split("/")).read_bytes()
    records = np.lcm(16, 8)
    copy = tmp_path / "scan.bin"
    copy.write_bytes(content[: len(content) // records * records])
    formats = binary_formats()
    assert not scan_findings(formats[right].read(copy), None)
    assert any(f.unusable for f in scan_findings(formats[wrong].read(copy), 0.0))


@pytest.mark.parametrize("name", ["rellis_os1_64", "rellis_vlp32c", "helipr_avia_000000"])
def test_other_scans_read_as_nclt_are_no_coordinates(name):
    """As `localize` sees them, without the missing returns."""
    content = real_data("other_sensors", f"{name}.bin")
    points = scan_from(binary_formats()["nclt"].read(content), content).points
    with pytest.raises(BrokenScanError, match=r"points fill .* check the format"):
        expect_coordinates(points)


@pytest.mark.parametrize("wrong", SENSORS)
@pytest.mark.parametrize("right", SENSORS)
def test_one_sensor_of_helipr_for_another(right, wrong, street, tmp_path):
    """All pairs of record types; a common multiple of both sizes, so that the size says nothing."""
    own, other = SENSORS[right].records[0], SENSORS[wrong].records[0]
    points = np.concatenate(street[0])
    count = np.lcm(own.itemsize, other.itemsize) // own.itemsize
    count *= len(points) // count
    records = np.zeros(count, own)
    rng = np.random.default_rng(0)
    for name in records.dtype.names:
        records[name] = points[:count] if name == "xyz" else rng.integers(0, 100, count)
    (tmp_path / "scan.bin").write_bytes(records.tobytes())
    found = scan_findings(SENSORS[wrong].read(tmp_path / "scan.bin"), HEIGHT)
    assert any(f.unusable for f in found) == (right != wrong)


def write_session(layout, folder, clouds, poses, content):
    """A drive in a layout whose files hold ``content(points)``: its format and the ground."""
    stamps = [1700000000_000000000 + 200_000_000 * k for k in range(len(clouds))]
    scans = {
        "mulran": "DCC01/Ouster",
        "nclt": "2031-01-01/velodyne_sync",
        "helipr": "Town01/LiDAR/Ouster",
        "custom": "scans",
    }[layout]
    (folder / scans).mkdir(parents=True)
    for stamp, points in zip(stamps, clouds, strict=True):
        name = stamp // 1000 if layout == "nclt" else stamp
        (folder / scans / f"{name}.bin").write_bytes(content(np.asarray(points, np.float64)))
    if layout == "mulran":
        rows_of = [
            ",".join([str(t), *map(repr, pose[:3].ravel().tolist())])
            for t, pose in zip(stamps, poses @ np.linalg.inv(T_BASE_LIDAR), strict=True)
        ]
        (folder / "DCC01" / "global_pose.csv").write_text("\n".join(rows_of))
        return folder, binary_formats()["mulran"].ground_z
    if layout == "nclt":
        down = np.diag([1.0, -1.0, -1.0, 1.0])
        turned = Rotation.from_matrix((down @ poses @ down)[:, :3, :3]).as_euler("xyz")
        table = np.column_stack([poses[:, :3, 3] * [1, -1, -1], turned])
        lines = [
            ",".join([str(t // 1000), *map(repr, row.tolist())])
            for t, row in zip(stamps, table, strict=True)
        ]
        (folder / "2031-01-01" / "groundtruth_2031-01-01.csv").write_text("\n".join(lines))
        return folder, 0.0
    if layout == "helipr":
        turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
        lines = [
            " ".join([str(t), *map(repr, [*pose[:3, 3].tolist(), *turn.tolist()])])
            for t, pose, turn in zip(stamps, poses, turns, strict=True)
        ]
        (folder / "Town01" / "LiDAR_GT").mkdir()
        (folder / "Town01/LiDAR_GT/global_Ouster_gt.txt").write_text("\n".join(lines))
        return folder, SENSORS["Ouster"].ground_z
    lines = [" ".join(map(repr, pose[:3].ravel().tolist())) for pose in poses]
    (folder / "poses.txt").write_text("\n".join(lines))
    (folder / "drive.yaml").write_text(
        "scans: scans\nposes: poses.txt\nformat: mulran\nsensor_height: 1.8\n"
    )
    return folder / "drive.yaml", HEIGHT


def multiple(array, record):
    """Bytes of so many rows that they are a whole number of records of that size."""
    size = array[0].nbytes
    step = np.lcm(size, record) // size
    return array[: len(array) // step * step].tobytes()


def velodyne(points):
    """Records of HeLiPR's Velodyne."""
    records = np.zeros(len(points), SENSORS["Velodyne"].records[0])
    records["xyz"] = points
    return records


def nclt_hits(points):
    hits = np.zeros(len(points), np.dtype([("xyz", "<u2", (3,)), ("rest", "u1", (2,))]))
    hits["xyz"] = np.rint((points * [1, -1, -1] + [0, 0, 1.8] + 100) / 0.005)
    return hits


LAYOUTS = {
    "mulran": {
        "right": (lambda p: rows(p, 4).tobytes(), None),
        "float64": (lambda p: rows(p, 4, "<f8").tobytes(), "float64 with 4 values"),
        "big-endian": (lambda p: rows(p, 4, ">f4").tobytes(), "big-endian float32"),
        "NCLT": (lambda p: multiple(nclt_hits(p), 16), None),
    },
    "nclt": {
        "KITTI": (lambda p: rows(p, 4).tobytes(), "format kitti"),
        "float64": (lambda p: rows(p, 4, "<f8").tobytes(), None),
        "centimetres": (lambda p: multiple((rows(p, 4, "f8") * 100).astype("<i2"), 8), None),
    },
    "helipr": {
        "Velodyne": (lambda p: multiple(velodyne(p), 26), "format helipr_velodyne"),
        "KITTI": (lambda p: multiple(rows(p, 4), 26), "format kitti"),
        "float64": (lambda p: multiple(rows(p, 4, "<f8"), 26), None),
    },
    "custom": {
        "right": (lambda p: rows(p, 4).tobytes(), None),
        "five values": (lambda p: whole_records(rows(p, 5)), "float32 with 5 values"),
        "millimetres": (lambda p: rows(p * 1000, 4).tobytes(), "points in millimetres"),
    },
}


@pytest.mark.parametrize(
    ("layout", "kind"), [(layout, kind) for layout, kinds in LAYOUTS.items() for kind in kinds]
)
def test_wrong_files_are_noticed_in_every_layout(layout, kind, street, tmp_path):
    content, named = LAYOUTS[layout][kind]
    root, ground_z = write_session(layout, tmp_path, *street, content)
    found = findings_of(open_session(layout, root, None), ground_z)
    assert any(finding.unusable for finding in found) == (kind != "right")
    if named is not None:
        assert named in found[0].advice


def with_files(session, files):
    """The session with these files, in the places of its first ones."""
    n = len(files)
    return replace(
        session,
        files=tuple(files),
        poses=session.poses[:n],
        ground_truth=session.ground_truth[:n],
    )


def test_one_file_many_times(street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "right", *street))
    same = with_files(session, [session.files[0]] * 8)
    assert any(f.unusable and "byte for byte" in f.found for f in findings_of(same, HEIGHT))
    once = with_files(session, [session.files[0], *session.files[:7]])
    (finding,) = findings_of(once, HEIGHT)
    assert not finding.unusable
    assert "1 of 7 files" in finding.found


@pytest.mark.parametrize("kind", ["float64", "big-endian", "five values", "UTM", "one plane"])
def test_one_wrong_scan_among_good_ones_is_named(kind, street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "right", *street))
    points, pose = np.asarray(street[0][3], np.float64), street[1][3]
    session.files[3].write_bytes(whole_records(WRONG[kind](points, pose)))
    found = findings_of(session, HEIGHT)
    assert any(str(session.files[3]) in finding.found for finding in found)
    assert not any(finding.unusable for finding in found)


def test_cut_and_merged_scans_differ_from_the_usual_number_of_points(street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "right", *street))
    content = session.files[2].read_bytes()
    session.files[2].write_bytes(content[: 16 * 300])
    session.files[5].write_bytes(content * 5)
    (finding,) = findings_of(session, HEIGHT)
    assert "2 of 8" in finding.found
    assert str(session.files[2]) in finding.found


def test_scans_that_cannot_be_read_are_left_to_others(street, tmp_path):
    session = open_kitti(write_wrong(tmp_path / "drive", "right", *street))
    session.files[2].unlink()
    session.files[3].write_bytes(bytes(160))
    assert findings_of(session, HEIGHT) == []
    for file in session.files:
        file.unlink(missing_ok=True)
    assert findings_of(session, HEIGHT) == []


def test_a_session_without_files_or_scans_is_not_doubted():
    nothing = Session("none", (), np.zeros((0, 4, 4)), np.zeros((0, 2)), None, lambda _: None)
    assert inspect(nothing, 0.0) == []


def test_a_crop_does_not_hide_the_ground(street, tmp_path):
    """A custom drive that keeps points above 2 m still shows its ground to the inspection."""
    folder = write_wrong(tmp_path / "drive", "right", *street)
    file = tmp_path / "drive.yaml"
    text = "scans: drive/velodyne\nposes: drive/poses.txt\nformat: kitti\nz_band: [2, 20]\n"
    for height, doubted in ((-HEIGHT, False), (0.4, True)):
        file.write_text(text + f"sensor_height: {height}\n")
        found = findings_of(open_session("custom", file, None), -height)
        assert [f.subject for f in found] == ["ground"] * doubted
    assert folder.is_dir()


def test_custom_scans_of_wrong_types_and_axes_are_named(street, tmp_path):
    file = tmp_path / "drive.yaml"
    text = "scans: drive/velodyne\nposes: drive/poses.txt\nformat: kitti\nsensor_height: 1.8\n"
    file.write_text(text)
    write_wrong(tmp_path / "drive", "float64", *street)
    assert "float64" in findings_of(open_session("custom", file, None), HEIGHT)[0].advice


@given(n=st.integers(0, 40), most=st.integers(1, 15))
def test_a_sample_is_spread_over_all(n, most):
    sample = sample_of(n, most)
    assert sample == sorted(set(sample))
    assert len(sample) == min(n, most)
    assert all(0 <= k < n for k in sample)
    if n and most > 1:
        assert sample[0] == 0
        assert sample[-1] == n - 1
    assert SAMPLE <= 16


@given(
    height=st.floats(-4, 4),
    slope=st.floats(-0.05, 0.05),
    seed=st.integers(0, 5),
)
def test_the_ground_is_found_under_walls_and_slopes(height, slope, seed):
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-30, 30, (6000, 2))
    ground = np.column_stack([flat, height + slope * flat[:, 0]])
    walls = np.column_stack([rng.uniform(-30, 30, (2000, 2)), height + rng.uniform(0, 8, 2000)])
    found, share = measure_ground(np.concatenate([ground, walls]))
    assert found == pytest.approx(height, abs=0.2)
    assert share > 0.4


@given(points=st.lists(st.tuples(*[st.floats(width=32)] * 3), max_size=60))
def test_any_numbers_can_be_measured(points):
    figures = measure_scan(np.array(points, dtype=np.float32).reshape(-1, 3))
    assert figures.points <= len(points)
    scan_findings(np.array(points, dtype=np.float32).reshape(-1, 3), -1.7)
    assert median_figures([figures]).points == figures.points


def test_missing_returns_are_counted_and_change_nothing_else(street):
    points = street[0][0]
    with_missing = np.repeat(points, 2, axis=0)
    with_missing[1::2] = [0, 0, 0]
    alone, mixed = measure_scan(points), measure_scan(with_missing)
    assert alone.missing == 0
    assert mixed.missing == 0.5
    assert mixed.ground == alone.ground
    assert scan_findings(with_missing, HEIGHT) == scan_findings(points, HEIGHT) == []


def test_rounding_errors_of_zero_are_no_wrong_types(street):
    points = np.asarray(street[0][0], dtype=np.float64).copy()
    points[::5, 1] = 1e-17
    points[::7, 2] = -1e-9
    assert not any("any unit" in f.found for f in scan_findings(points, HEIGHT))


def room(height, half, top):
    """Rays of a LiDAR at this height in a room of half its width, with a ceiling at ``top``."""
    turn, tilt = np.meshgrid(np.linspace(-np.pi, np.pi, 600), np.radians(np.linspace(-22, 22, 32)))
    rays = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)], -1)
    rays = rays.reshape(-1, 3)
    walls = [half[0], half[1], 0.0]
    with np.errstate(divide="ignore"):
        reach = np.min([np.abs(walls[k] / rays[:, k]) for k in (0, 1)], axis=0)
        reach = np.minimum(reach, np.where(rays[:, 2] > 0, top, height) / np.abs(rays[:, 2]))
    noise = np.random.default_rng(0).normal(0, 0.02, rays.shape)
    return rays[reach < 100] * reach[reach < 100, None] + noise[reach < 100]


@pytest.mark.parametrize(
    ("height", "half", "top"),
    [
        *[(0.5, (4, 3), 2.0), (0.6, (40, 1.2), 1.8), (1.7, (300, 300), 0.6)],  # room, corridor,
        *[(1.8, (300, 4), 3.0), (1.8, (300, 9), 60.0)],  # garage, tunnel, narrow street
    ],
)
def test_indoors_and_between_walls_is_not_doubted(height, half, top):
    assert scan_findings(room(height, half, top), -height, single=False) == []
