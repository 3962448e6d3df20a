"""PLY files: whatever was written is read back, and what is no whole file is refused."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from deepring.data.scans.ply import read_ply
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError

SAME_FOLDER = settings(
    deadline=None,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
COUNTS = [name for name in TYPES if not name.startswith(("f", "d"))]
FORMATS = ["ascii", "binary_little_endian", "binary_big_endian"]


def numbers(kind):
    dtype = np.dtype(TYPES[kind])
    if dtype.kind == "f":
        return st.floats(width=8 * dtype.itemsize, allow_nan=False, allow_infinity=False)
    info = np.iinfo(dtype)
    return st.integers(int(info.min), int(info.max))


@st.composite
def properties(draw, name):
    """(name, type of a list's count or None, type)."""
    count = draw(st.sampled_from([None, None, *COUNTS]))
    return name, count, draw(st.sampled_from(list(TYPES)))


@st.composite
def elements(draw, name):
    """(name, properties, rows); the vertex has x, y and z somewhere among others."""
    extra = [draw(properties(f"p{k}")) for k in range(draw(st.integers(0, 2)))]
    if name == "vertex":
        extra += [(axis, None, draw(st.sampled_from(list(TYPES)))) for axis in "xyz"]
    kinds = draw(st.permutations(extra))
    rows = []
    for _ in range(draw(st.integers(0, 4))):
        row = []
        for _, count, kind in kinds:
            value = numbers(kind) if count is None else st.lists(numbers(kind), max_size=3)
            row.append(draw(value))
        rows.append(row)
    return name, kinds, rows


@st.composite
def files(draw):
    names = draw(
        st.permutations(["vertex", *draw(st.sampled_from([[], ["face"], ["edge", "face"]]))])
    )
    return [draw(elements(name)) for name in names]


def encoded(contents, form, newline="\n"):
    lines = ["ply", f"format {form} 1.0", "comment end_header is near"]
    body = []
    order = ">" if "big" in form else "<"
    for name, kinds, rows in contents:
        lines.append(f"element {name} {len(rows)}")
        for label, count, kind in kinds:
            lines.append(f"property {kind if count is None else f'list {count} {kind}'} {label}")
        for row in rows:
            texts = []
            for (_, count, kind), value in zip(kinds, row, strict=True):
                values = [value] if count is None else value
                if form == "ascii":
                    texts += [] if count is None else [str(len(values))]
                    texts += [repr(v) for v in values]
                else:
                    if count is not None:
                        body.append(np.array(len(values), order + TYPES[count]).tobytes())
                    body.append(np.array(values, order + TYPES[kind]).tobytes())
            if form == "ascii":
                body.append((" ".join(texts) + newline).encode())
    header = newline.join([*lines, "end_header", ""])
    return header.encode() + b"".join(body)


def points_of(contents):
    (_, kinds, rows), *_ = [e for e in contents if e[0] == "vertex"]
    axes = [[label for label, *_ in kinds].index(axis) for axis in "xyz"]
    values = [[np.dtype(TYPES[kinds[k][2]]).type(row[k]) for k in axes] for row in rows]
    with np.errstate(over="ignore"):
        return np.array([[v.astype(np.float32) for v in row] for row in values]).reshape(-1, 3)


@SAME_FOLDER
@given(files(), st.sampled_from(FORMATS), st.sampled_from(["\n", "\r\n"]))
def test_what_was_written_is_read_back(tmp_path, contents, form, newline):
    path = tmp_path / "a.ply"
    path.write_bytes(encoded(contents, form, newline))
    points = read_ply(path)
    assert points.dtype == np.float32
    np.testing.assert_array_equal(points, points_of(contents))


@SAME_FOLDER
@given(files(), st.sampled_from(FORMATS), st.data())
def test_short_and_long_files_are_refused(tmp_path, contents, form, data):
    """Every byte, or number, behind the header counts, also those of other elements."""
    path = tmp_path / "a.ply"
    whole = encoded(contents, form)
    path.write_bytes(whole + (b" 7" if form == "ascii" else b"\0"))
    with pytest.raises(BrokenScanError, match=r"a\.ply: [18] bytes more than its header says"):
        read_ply(path)
    start = whole.index(b"\nend_header\n") + 12
    cut = data.draw(st.integers(0, max(len(whole) - start - 1, 0)))
    shorter = whole[: start + cut]
    assume(len(shorter) < len(whole) and shorter[start:].split() != whole[start:].split())
    if form == "ascii":  # cut within a number it would be another number
        shorter = shorter[: max(shorter.rfind(b" "), shorter.rfind(b"\n")) + 1]
        shorter = shorter if len(shorter) >= start else whole[:start]
    path.write_bytes(shorter)
    with pytest.raises(BrokenScanError, match=r"a\.ply: ends within element \w+ \d+ of its header"):
        read_ply(path)


@SAME_FOLDER
@given(st.binary(max_size=80), st.binary(max_size=40), st.sampled_from(FORMATS))
def test_any_other_content_is_a_broken_scan(tmp_path, header, body, form):
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nformat %s 1.0\n%s\nend_header\n%s" % (form.encode(), header, body))
    with pytest.raises(BrokenScanError, match=r"a\.ply: "):
        read_ply(path)


HEAD = "ply\nformat {form} 1.0\nelement vertex {n}\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "does not begin with the line 'ply'"),
        (b"solid", "does not begin with the line 'ply'"),
        (b"ply\nformat ascii 1.0\n", "a header without end_header"),
        (b"ply\nelement vertex 0\nend_header\n", "format missing"),
        (b"ply\nformat text 1.0\nend_header\n", "format text, not one of ascii"),
        (b"ply\nformat ascii 1.0\nend_header\n", "no element vertex"),
        (b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "line 'element vertex many'"),
        (b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "line 'element vertex -1'"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "line 'property float x'"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n",
            "line 'property half x'",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
            "element vertex 1 of its header has x, not x, y and z",
        ),
        (
            b"ply\nformat ascii 1.0\nelement face 1\nproperty list char int v\nend_header\n-1\n",
            "a list of -1 items in element face 1",
        ),
        (
            HEAD.format(form="ascii", n=2).encode() + b"end_header\n1 2 3\n4 five 6\n",
            "an ascii body with values other than numbers",
        ),
        (
            HEAD.format(form="binary_little_endian", n=10**17).encode()
            + b"end_header\n"
            + bytes(36),
            "ends within element vertex 100000000000000000 of its header, after 3 rows",
        ),
        (
            HEAD.format(form="binary_little_endian", n=2).encode() + b"end_header\n" + bytes(25),
            r"1 bytes more than its header says \(element vertex 2\)",
        ),
    ],
)
def test_what_is_wrong_is_said(tmp_path, content, words):
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    with pytest.raises(BrokenScanError, match=rf"scan .*a\.ply: .*{words}"):
        read_scan(path)


def test_a_missing_file_is_a_broken_scan(tmp_path):
    with pytest.raises(BrokenScanError, match=r"none\.ply: cannot be read"):
        read_ply(tmp_path / "none.ply")


def test_vertices_that_no_face_uses_are_kept(tmp_path):
    """A mesh library drops them, and merges those that lie at one place."""
    points = np.random.default_rng(0).normal(0, 20, (20_000, 3)).astype("<f4")
    points[5:9] = points[4]
    head = HEAD.format(form="binary_little_endian", n=len(points))
    faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.array([(3, [0, 1, 2]), (3, [1, 2, 3])], [("n", "u1"), ("v", "<i4", (3,))])
    (tmp_path / "a.ply").write_bytes((head + faces).encode() + points.tobytes() + rows.tobytes())
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply"), points)
