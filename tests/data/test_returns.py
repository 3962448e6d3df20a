"""One rule for missing returns: NaN, infinite and (0, 0, 0) records of every format are none."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.data.scans.point_cloud2 import cloud_records
from deepring.data.scans.returns import is_return, scan_from
from deepring.data.scans.scan_files import read_scan
from deepring.data.session import Session
from deepring.errors import BrokenScanError
from helpers.bags import message

VALUE = st.one_of(
    st.sampled_from([0.0, -0.0, math.nan, math.inf, -math.inf, 1e-30]), st.floats(width=32)
)


@given(st.lists(st.tuples(VALUE, VALUE, VALUE), max_size=8))
def test_the_rule_is_that_of_its_words(rows):
    kept = [row for row in rows if all(math.isfinite(v) for v in row) and any(v != 0 for v in row)]
    records = np.array(rows, dtype=np.float32).reshape(-1, 3)
    np.testing.assert_array_equal(records[is_return(records)], np.float32(kept).reshape(-1, 3))
    if kept:
        scan = scan_from(records, "a")
        np.testing.assert_array_equal(scan.points, np.float32(kept))
        assert scan.missing == len(rows) - len(kept)
    else:
        with pytest.raises(BrokenScanError, match=r"a: (no points|.* all missing returns)"):
            scan_from(records, "a")


def test_a_point_on_an_axis_is_no_missing_return():
    axes = np.eye(3, dtype=np.float32)
    assert is_return(axes).all()


def test_doubles_beyond_floats_are_missing_without_a_warning():
    scan = scan_from(np.array([[1e300, 1, 1], [1, 2, 3]]), "a")
    assert scan.points.dtype == np.float32
    assert scan.missing == 1


def test_a_signalling_nan_is_missing_without_a_warning():
    records = np.ones((3, 3), np.float32)
    records.view(np.uint32)[1, 2] = 0x7F800001
    assert is_return(records).tolist() == [True, False, True]


def npy(path, points):
    np.save(path.with_suffix(".npy"), points)
    return read_scan(path.with_suffix(".npy"))


def kitti(path, points):
    np.c_[points, points[:, :1]].astype("<f4").tofile(path.with_suffix(".bin"))
    return read_scan(path.with_suffix(".bin"), "kitti")


def mulran(path, points):
    np.c_[points, points[:, :1]].astype("<f4").tofile(path.with_suffix(".bin"))
    return read_scan(path.with_suffix(".bin"), "mulran")


def ply(path, points):
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.with_suffix(".ply").write_bytes(head.encode() + points.tobytes())
    return read_scan(path.with_suffix(".ply"))


def cloud(path, points):
    return scan_from(cloud_records(message(points)), path).points


def pcd(path, points):
    head = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH 1\nHEIGHT {len(points)}\nPOINTS {len(points)}\nDATA binary\n"
    )
    path.with_suffix(".pcd").write_bytes(head.encode() + points.tobytes())
    return read_scan(path.with_suffix(".pcd"))


def session(path, points):
    poses = np.eye(4)[None]
    return Session("a", (path,), poses, poses[:, :2, 3], None, lambda _: points).points(0)


@pytest.mark.parametrize("written", [npy, kitti, mulran, ply, pcd, cloud, session])
def test_every_path_drops_the_same(tmp_path, written):
    points = np.random.default_rng(0).normal(0, 20, (12, 3)).astype("<f4")
    points[[2, 5]], points[3, 1], points[4, 2], points[7] = 0, np.nan, -np.inf, np.nan
    points[8] = [0, 0, 1]  # a point, though on an axis
    kept = np.delete(points, [2, 3, 4, 5, 7], axis=0)
    np.testing.assert_array_equal(written(tmp_path / "a", points), kept)
