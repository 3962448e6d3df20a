"""Scans from files of each kind; what is no scan says so."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.data.scans.scan_files import read_scan, scan_files
from deepring.errors import BrokenScanError, DeepringError

POINTS = np.random.default_rng(0).normal(0, 20, (50, 3)).astype(np.float32)


def write_pcd(path, data):
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\n"
        f"COUNT 1 1 1 1\nWIDTH {len(POINTS)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(POINTS)}\nDATA {data}\n"
    )
    rows = np.column_stack([POINTS, np.ones(len(POINTS))]).astype("<f4")
    lines = "\n".join(" ".join(repr(float(v)) for v in row) for row in rows) + "\n"
    path.write_bytes(head.encode() + (rows.tobytes() if data == "binary" else lines.encode()))


def write_ply(path, data):
    head = (
        f"ply\nformat {data} 1.0\nelement vertex {len(POINTS)}\nproperty float x\n"
        "property float y\nproperty float z\nend_header\n"
    )
    lines = "\n".join(" ".join(repr(float(v)) for v in row) for row in POINTS) + "\n"
    order = ">f4" if "big" in data else "<f4"
    body = lines.encode() if data == "ascii" else POINTS.astype(order).tobytes()
    path.write_bytes(head.encode() + body)


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_pcd(tmp_path, data):
    write_pcd(tmp_path / "a.pcd", data)
    assert np.allclose(read_scan(tmp_path / "a.pcd"), POINTS, atol=1e-5)


@pytest.mark.parametrize("data", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply(tmp_path, data):
    write_ply(tmp_path / "a.ply", data)
    found = read_scan(tmp_path / "a.ply")
    assert found.dtype == np.float32
    assert np.allclose(found, POINTS, atol=1e-5)


@pytest.mark.parametrize("width", [3, 5])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_npy(tmp_path, width, dtype):
    wide = np.column_stack([POINTS, np.ones((50, 2))])[:, :width].astype(dtype)
    np.save(tmp_path / "a.npy", wide)
    assert np.allclose(read_scan(tmp_path / "a.npy"), POINTS)


def test_bin_is_what_it_is_said_to_be(tmp_path):
    rows = np.column_stack([POINTS, np.ones(50)]).astype("<f4")
    rows.tofile(tmp_path / "a.bin")
    assert np.array_equal(read_scan(tmp_path / "a.bin", "kitti"), POINTS)
    with pytest.raises(DeepringError, match="does not contain its format"):
        read_scan(tmp_path / "a.bin")


@pytest.mark.parametrize("ending", ["npy", "pcd", "ply"])
@given(content=st.binary(max_size=300))
def test_files_of_other_content_are_broken_scans(tmp_path_factory, ending, content):
    path = tmp_path_factory.mktemp("scans") / f"a.{ending}"
    path.write_bytes(content)
    with pytest.raises(BrokenScanError, match=rf"a\.{ending}"):
        read_scan(path)


def test_arrays_that_are_no_points_are_refused(tmp_path):
    for name, array in {"flat": np.zeros(9), "narrow": np.zeros((3, 2))}.items():
        np.save(tmp_path / f"{name}.npy", array)
        with pytest.raises(BrokenScanError, match=r"expected \(n, 3\) or wider"):
            read_scan(tmp_path / f"{name}.npy")
    np.save(tmp_path / "words.npy", np.full((4, 3), "word"))
    with pytest.raises(BrokenScanError, match=r"type '<U4', not of real numbers"):
        read_scan(tmp_path / "words.npy")


def test_folders_give_their_scans_in_order(tmp_path):
    for name in ("b.npy", "a.pcd", "note.txt"):
        (tmp_path / name).touch()
    assert [p.name for p in scan_files([tmp_path])] == ["a.pcd", "b.npy"]
    assert scan_files([tmp_path / "b.npy"]) == [tmp_path / "b.npy"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(DeepringError, match="a folder without scans"):
        scan_files([tmp_path / "empty"])
    with pytest.raises(DeepringError, match="no such file or folder"):
        scan_files([tmp_path / "c.npy"])
    with pytest.raises(DeepringError, match="no such file"):
        read_scan(tmp_path / "c.npy")
    with pytest.raises(DeepringError, match=r"unknown ending '\.txt'"):
        read_scan(tmp_path / "note.txt")
