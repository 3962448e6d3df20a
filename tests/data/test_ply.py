"""PLY files: whatever was written is read back, and what is no whole file is refused."""

import time

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
    path.write_bytes(whole + (b"7" if form == "ascii" else b"\0"))
    with pytest.raises(BrokenScanError, match=r"a\.ply: 1 (bytes|lines) more than its header says"):
        read_ply(path)
    start = whole.index(b"\nend_header\n") + 12
    cut = data.draw(st.integers(0, max(len(whole) - start - 1, 0)))
    shorter = whole[: start + cut]
    assume(len(shorter) < len(whole) and shorter[start:].split() != whole[start:].split())
    if form == "ascii":  # cut within a number it would be another number
        shorter = shorter[: max(shorter.rfind(b" "), shorter.rfind(b"\n")) + 1]
        shorter = shorter if len(shorter) >= start else whole[:start]
    path.write_bytes(shorter)
    words = (
        r"(ends within element|a row of element|a list of '' items in element|.* not \d numbers)"
    )
    with pytest.raises(BrokenScanError, match=rf"a\.ply: {words}"):
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
WITH_FACE = HEAD.replace("{n}", "0") + "element face 1\nproperty list char int v\nend_header\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "0 bytes, an empty file"),
        (b"solid", "does not begin with the line 'ply'"),
        (b"ply\nformat ascii 1.0\n", "a header without end_header"),
        (b"ply\nelement vertex 0\nend_header\n", "format missing"),
        (b"ply\nformat text 1.0\nend_header\n", "format text, not one of ascii"),
        (b"ply\nformat ascii 1.0\nend_header\n", "no elements vertex in its header, not one"),
        (b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "line 'element vertex many'"),
        (b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "line 'element vertex -1'"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "line 'property float x'"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n",
            "line 'property half x'",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
            "fields x: no y, expected x, y and z once each",
        ),
        (
            WITH_FACE.format(form="ascii").encode() + b"-1\n",
            "a list of '-1' items in element face 1",
        ),
        (
            WITH_FACE.format(form="binary_big_endian").encode() + b"\xff",
            "a list of -1 items in element face 1",
        ),
        (
            HEAD.format(form="ascii", n=2).encode() + b"end_header\n1 2 3\n4 five 6\n",
            "line 2 after its header reads '4 five 6', not 3 numbers",
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


def written(path, form, properties, rows, elements="", body=b""):
    """A PLY file whose vertices are ``rows`` of doubles, between other elements."""
    head = f"ply\nformat {form} 1.0\n{elements}element vertex {len(rows)}\n"
    head += "".join(f"property {p}\n" for p in properties) + "end_header\n"
    order = ">f8" if "big" in form else "<f8"
    if form == "ascii":
        numbers = "".join(" ".join(map(repr, map(float, row))) + "\n" for row in rows).encode()
    else:
        numbers = np.array(rows, order).tobytes()
    path.write_bytes(head.encode() + body + numbers)
    return path


@pytest.mark.parametrize("form", FORMATS)
def test_upper_case_coordinates_are_taken_where_lower_case_ones_lack(tmp_path, form):
    doubles = [f"double {name}" for name in ("X", "Z", "Y", "y")]
    path = written(tmp_path / "a.ply", form, doubles, [[1, 3, 7, 2]])
    np.testing.assert_array_equal(read_ply(path), [[1, 2, 3]])


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("properties", "words"),
    [
        (["double x", "double y", "double z", "double x"], "fields x y z x: x twice, expected"),
        (["double X", "double Y", "double Z", "double Z"], "fields X Y Z Z: z twice, expected"),
        (["double y", "double z", "double nx"], "fields y z nx: no x, expected"),
    ],
)
def test_each_coordinate_is_there_once(tmp_path, form, properties, words):
    path = written(tmp_path / "a.ply", form, properties, [range(len(properties))])
    with pytest.raises(BrokenScanError, match=rf"a\.ply: {words}"):
        read_ply(path)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("elements", "words"),
    [
        ("element vertex 0\nproperty double x\n", "2 elements vertex in its header, not one"),
        ("format {form} 1.0\n", "the header line 'format "),
        ("element camera 1\n", None),  # without properties, so without a row
        ("comment element vertex 9\n", None),
    ],
)
def test_headers_with_more_in_them(tmp_path, form, elements, words):
    doubles = [f"double {name}" for name in "xyz"]
    path = written(tmp_path / "a.ply", form, doubles, [[1, 2, 3]], elements.format(form=form))
    if words is None:
        np.testing.assert_array_equal(read_ply(path), [[1, 2, 3]])
    else:
        with pytest.raises(BrokenScanError, match=words):
            read_ply(path)


@pytest.mark.parametrize(
    "rows", ["1 2\n3 4 5 6\n", "1 2 3 4 5 6\n", "1 2 3\n4 5\n6\n", "1 2 1_0\n4 5 6\n"]
)
def test_a_row_of_text_is_a_line_of_numbers(tmp_path, rows):
    """Six numbers are not two points wherever they stand."""
    head = HEAD.format(form="ascii", n=2) + "end_header\n"
    (tmp_path / "a.ply").write_text(head + "1 2 3\n\n  4 5 6")
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply"), [[1, 2, 3], [4, 5, 6]])
    (tmp_path / "a.ply").write_text(head + rows)
    with pytest.raises(BrokenScanError, match=r"a\.ply: (line [12]|ends within|1 lines more)"):
        read_ply(tmp_path / "a.ply")


def test_text_of_a_type_that_cannot_hold_it_is_refused(tmp_path):
    head = HEAD.format(form="ascii", n=1).replace("float", "uchar") + "end_header\n"
    for value in ("256", "-1", "1.5", "nan"):
        (tmp_path / "a.ply").write_text(head + f"1 {value} 3\n")
        with pytest.raises(BrokenScanError, match=f"a coordinate {value} in a field of type uint8"):
            read_ply(tmp_path / "a.ply")


def test_many_faces_of_several_lengths_are_skipped_quickly(tmp_path):
    faces = [bytes([n]) + bytes(4 * n) for n in (3, 4)] * 50_000
    head = HEAD.format(form="binary_little_endian", n=2)
    elements = f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = np.arange(6, dtype="<f4").tobytes() + b"".join(faces)
    (tmp_path / "a.ply").write_bytes((head + elements).encode() + body)
    start = time.perf_counter()
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply"), [[0, 1, 2], [3, 4, 5]])
    assert time.perf_counter() - start < 2
