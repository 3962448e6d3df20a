"""NumPy's .npy files: read as NumPy reads them, or refused, never evaluated."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from deepring.data.scans.npy import read_npy
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError

SAME_FOLDER = settings(
    deadline=None,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
TYPES = [f"{order}{kind}" for order in "<>" for kind in ("f2", "f4", "f8", "i2", "i4", "u8")]
SHAPES = [(5, 3), (1, 3), (9, 8), (2, 5), (4, 6, 3), (1, 5, 4), (5, 1, 3), (0, 3)]


@SAME_FOLDER
@given(st.data(), st.sampled_from([*TYPES, "i1", "u1"]), st.sampled_from(SHAPES), st.booleans())
def test_it_is_what_numpy_reads(tmp_path, data, kind, shape, fortran):
    array = data.draw(hnp.arrays(np.dtype(kind), shape))
    np.save(tmp_path / "a.npy", np.asfortranarray(array) if fortran else array)
    with np.errstate(over="ignore"):
        expected = np.load(tmp_path / "a.npy").reshape(-1, shape[-1])[:, :3].astype(np.float32)
    points = read_npy(tmp_path / "a.npy")
    assert points.dtype == np.float32
    np.testing.assert_array_equal(points, expected)
    whole = (tmp_path / "a.npy").read_bytes()
    for content in (whole + b"\0", whole[:-1]):
        (tmp_path / "b.npy").write_bytes(content)
        with pytest.raises(BrokenScanError, match=r"b\.npy: \d+ bytes|ends within its header"):
            read_npy(tmp_path / "b.npy")


def saved(path, header, body=b"", version=(1, 0)):
    length = len(header).to_bytes(2 if version[0] == 1 else 4, "little")
    path.write_bytes(b"\x93NUMPY" + bytes(version) + length + header.encode() + body)
    return path


POINTS = np.random.default_rng(0).normal(0, 20, (4, 3)).astype("<f4")


@pytest.mark.parametrize(
    ("header", "version"),
    [
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3), }      \n", (1, 0)),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3)}", (2, 0)),
        ("{'shape': (4,3), 'fortran_order': False, 'descr': 'f4'}\n", (3, 0)),
        ('{"descr": "<f4", "fortran_order": False, "shape": (4L, 3L)}\n', (1, 0)),  # Python 2
    ],
)
def test_headers_of_other_programs_are_read(tmp_path, header, version):
    path = saved(tmp_path / "a.npy", header, POINTS.tobytes(), version)
    np.testing.assert_array_equal(read_npy(path), POINTS)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("", "the header ''"),
        ("{'descr': '<f4', 'fortran_order': False}", "the header"),
        ("{'descr': '<f4', 'shape': (4, 3), 'shape': (4, 3)}", "a header with shape twice"),
        ("{'descr': '<f4', 'fortran_order': 'no', 'shape': (4, 3)}", "the header"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': '43'}", "the header"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4, -3)}", "the header"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3)} + 1", "the header"),
        ("{'descr': __import__('os'), 'fortran_order': False, 'shape': (4, 3)}", "the header"),
        (
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3)}",
            r"48 bytes after its header, not 12000000000000 for shape \(1000000000000, 3\)",
        ),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4 3)}", r"shape '\(4 3\)'"),
        ("{'descr': '|O', 'fortran_order': False, 'shape': (4, 3)}", r"an array of type '\|O'"),
        ("(" * 5000, "the header"),
    ],
)
def test_headers_that_are_none_are_refused(tmp_path, header, words):
    path = saved(tmp_path / "a.npy", header, POINTS.tobytes())
    with pytest.raises(BrokenScanError, match=rf"a\.npy: {words}[^\n]*complete \.npy file"):
        read_npy(path)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros(9), r"an array of shape \(9,\): expected \(n, 3\) or wider"),
        (np.zeros((3, 2)), r"an array of shape \(3, 2\): expected \(n, 3\) or wider"),
        (np.zeros(()), r"an array of shape \(\)"),
        (np.zeros((2, 2, 2, 3)), r"an array of shape \(2, 2, 2, 3\)"),
        (np.zeros((3, 400)), r"shape \(3, 400\): more columns than rows.*transpose it"),
        (np.zeros((64, 1024)), r"shape \(64, 1024\): more columns than rows"),
        (np.zeros((1000, 256)), r"shape \(1000, 256\): 256 numbers for each point"),
        (np.zeros((3, 64, 1024)), r"shape \(3, 64, 1024\): 1024 numbers for each point"),
        (np.zeros((4, 3), complex), "type '<c16', not of real numbers"),
        (np.zeros((4, 3), bool), r"type '\|b1', not of real numbers"),
        (np.full((4, 3), "word"), "type '<U4', not of real numbers"),
        (np.zeros((4, 3), "M8[ns]"), r"type '<M8\[ns\]', not of real numbers"),
        (np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4")]), "an array of records"),
    ],
)
def test_arrays_that_are_no_points_are_refused(tmp_path, array, words):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(BrokenScanError, match=rf"a\.npy: .*{words}"):
        read_scan(tmp_path / "a.npy")


def test_pickled_objects_are_refused_and_not_loaded(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[1, 2, None]], dtype=object))
    with pytest.raises(BrokenScanError, match=r"type '\|O', not of real numbers"):
        read_scan(tmp_path / "a.npy")


def test_an_archive_of_arrays_is_none(tmp_path):
    with (tmp_path / "a.npy").open("wb") as file:
        np.savez(file, POINTS)
    with pytest.raises(BrokenScanError, match=r"a\.npy: does not begin as a \.npy file"):
        read_npy(tmp_path / "a.npy")


def test_doubles_beyond_floats_are_missing_returns(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[1e300, 0, 0], [-1e300, 1, 1], [1, 2, 3]]))
    np.testing.assert_array_equal(read_scan(tmp_path / "a.npy"), [[1, 2, 3]])
