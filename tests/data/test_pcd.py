"""PCD files, beside a writer and a decoder that go number by number."""

import math
import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deepring.data.scans import pcd
from deepring.data.scans.pcd import read_pcd
from deepring.data.scans.scan_files import read_scan
from deepring.errors import BrokenScanError
from fuzz.decoders.lzf import compress

SAME_FOLDER = settings(
    deadline=None,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
LETTERS = {
    **{("F", 4): "f", ("F", 8): "d", ("I", 1): "b", ("I", 2): "h", ("I", 4): "i", ("I", 8): "q"},
    **{("U", 1): "B", ("U", 2): "H", ("U", 4): "I", ("U", 8): "Q"},
}
ENCODINGS = ["ascii", "binary", "binary_compressed"]


def encoded(fields, rows, data, newline="\n", height=1, lines=None):
    """fields: (name, (TYPE, SIZE), COUNT); rows: for each point the values of each field."""
    head = {
        "VERSION": "0.7",
        "FIELDS": " ".join(name for name, *_ in fields),
        "SIZE": " ".join(str(kind[1]) for _, kind, _ in fields),
        "TYPE": " ".join(kind[0] for _, kind, _ in fields),
        "COUNT": " ".join(str(count) for *_, count in fields),
        "WIDTH": len(rows) // height,
        "HEIGHT": height,
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": len(rows),
        **(lines or {}),
        "DATA": data,
    }
    text = "".join(f"{k} {v}{newline}" for k, v in head.items() if v is not None)
    if data == "ascii":
        body = "".join(
            " ".join(str(v) for values in row for v in values) + newline for row in rows
        ).encode()
    elif data == "binary":
        body = b"".join(
            struct.pack(f"<{count}{LETTERS[kind]}", *values)
            for row in rows
            for (_, kind, count), values in zip(fields, row, strict=True)
        )
    else:
        raw = b"".join(
            struct.pack(f"<{count}{LETTERS[kind]}", *row[k])
            for k, (_, kind, count) in enumerate(fields)
            for row in rows
        )
        small = compress(raw)
        body = struct.pack("<II", len(small), len(raw)) + small
    return text.encode() + body


def values(kind):
    letter, size = kind
    if letter == "F":
        return st.floats(width=8 * size)
    bits = 8 * size
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if letter == "I" else (0, 2**bits - 1)
    return st.integers(low, high)


@st.composite
def clouds(draw):
    """Fields, x, y and z somewhere among others, and rows."""
    kinds = st.sampled_from(list(LETTERS))
    fields = [(axis, draw(kinds), 1) for axis in draw(st.sampled_from(["xyz", "XYZ", "xYz"]))]
    for name in draw(st.lists(st.sampled_from(["_", "rgb", "ring", "t"]), max_size=3)):
        fields.append((name, draw(kinds), draw(st.integers(1, 5))))
    fields = draw(st.permutations(fields))
    row = st.tuples(*[st.lists(values(kind), min_size=n, max_size=n) for _, kind, n in fields])
    return fields, draw(st.lists(row, max_size=8))


def points_of(fields, rows):
    """The points by the definition: each x, y and z, rounded to float32 by itself."""
    places = [[name.lower() for name, *_ in fields].index(axis) for axis in "xyz"]
    found = []
    for row in rows:
        point = []
        for place in places:
            number = row[place][0]
            number = float(number) if isinstance(number, float) else int(number)
            with np.errstate(over="ignore"):
                point.append(np.float32(number))
        found.append(point)
    return np.array(found, np.float32).reshape(-1, 3)


@SAME_FOLDER
@given(clouds(), st.sampled_from(ENCODINGS), st.sampled_from(["\n", "\r\n"]))
def test_what_was_written_is_read_back(tmp_path, cloud, data, newline):
    fields, rows = cloud
    (tmp_path / "a.pcd").write_bytes(encoded(fields, rows, data, newline))
    points = read_pcd(tmp_path / "a.pcd")
    assert points.dtype == np.float32
    np.testing.assert_allclose(points, points_of(fields, rows), rtol=2e-7)


@SAME_FOLDER
@given(clouds(), st.sampled_from(ENCODINGS), st.data())
def test_short_and_long_files_are_refused(tmp_path, cloud, data, draw):
    fields, rows = cloud
    whole = encoded(fields, rows, data)
    start = whole.index(b"DATA ") + len(f"DATA {data}\n")
    longer = whole + (b"7\n" if data == "ascii" else b"\0")
    cut = draw.draw(st.integers(start, len(whole)))
    if data == "ascii":  # at a line
        cut = start + len(b"".join(whole[start:cut].splitlines(keepends=True)[:-1]))
    for content in (longer, *([whole[:cut]] if cut < len(whole) else [])):
        (tmp_path / "a.pcd").write_bytes(content)
        with pytest.raises(BrokenScanError, match=r"a\.pcd: .*; expected a complete PCD file$"):
            read_pcd(tmp_path / "a.pcd")


@SAME_FOLDER
@given(clouds(), st.sampled_from(ENCODINGS), st.data())
def test_a_changed_byte_is_read_or_refused(tmp_path, cloud, data, draw):
    content = bytearray(encoded(*cloud, data))
    at = draw.draw(st.integers(0, len(content) - 1))
    content[at] = draw.draw(st.integers(0, 255))
    (tmp_path / "a.pcd").write_bytes(content)
    with suppress(BrokenScanError):
        assert read_pcd(tmp_path / "a.pcd").shape[1] == 3


POINTS = np.random.default_rng(0).normal(0, 20, (600, 3)).astype("<f4")
FIELDS = [(axis, ("F", 4), 1) for axis in "xyz"]
ROWS = [tuple([float(v)] for v in point) for point in POINTS]


def test_lzf_is_unpacked():
    """The writer's packing refers back, also to what the reference itself writes."""
    raw = bytes(range(40)) * 9 + bytes(700)
    small = compress(raw)
    assert len(small) < 100
    out = np.empty(len(raw), np.uint8)
    from deepring.data.scans._lzf_kernel import unpack

    assert unpack(np.frombuffer(small, np.uint8), out)
    assert out.tobytes() == raw
    for damaged in (small[:-1], small + b"\0", b"\x20\x00" + small):
        assert not unpack(np.frombuffer(damaged, np.uint8), out)


@pytest.mark.parametrize("data", ENCODINGS)
@pytest.mark.parametrize(
    "lines",
    [
        {"VERSION": ".7"},
        {"VERSION": ".5", "VIEWPOINT": None},
        {"VERSION": "0.6", "VIEWPOINT": None},
        {"VERSION": None, "COUNT": None},
        {"SIZE": None, "TYPE": None, "COUNT": None, "WIDTH": None, "HEIGHT": None},
        {"VERSION": "", "VIEWPOINT": ""},
        {"POINTS": None},
        {"HEIGHT": None},
        {"FIELDS": None, "COLUMNS": "x y z", "VERSION": ".5"},
        {"VERSION": "0.7\n# a remark\n\n# FIELDS a b c"},
    ],
    ids=str,
)
def test_headers_of_all_versions_are_read(tmp_path, data, lines):
    (tmp_path / "a.pcd").write_bytes(encoded(FIELDS, ROWS, data, lines=lines))
    np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd"), POINTS)


def test_organised_clouds_have_their_missing_returns_dropped(tmp_path):
    holes = POINTS.copy()
    holes[::3], holes[1] = np.nan, 0
    rows = [tuple([float(v)] for v in point) for point in holes]
    for data in ENCODINGS:
        (tmp_path / "a.pcd").write_bytes(encoded(FIELDS, rows, data, height=20))
        assert len(read_pcd(tmp_path / "a.pcd")) == 600
        kept = np.delete(POINTS, [*range(0, 600, 3), 1], axis=0)
        np.testing.assert_array_equal(read_scan(tmp_path / "a.pcd"), kept)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        *(("nan", math.nan), ("-nan", math.nan), ("NaN", math.nan), ("nan(ind)", math.nan)),
        *(("1.#QNAN", math.nan), ("-1.#IND00", math.nan), ("1.#INF", math.inf)),
        *(("inf", math.inf), ("-inf", -math.inf), ("1e300", math.inf), ("+1.5E1", 15.0)),
    ],
)
def test_texts_of_numbers(tmp_path, text, number):
    (tmp_path / "a.pcd").write_bytes(encoded(FIELDS, [([text], [1], [2])], "ascii"))
    np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd"), [[number, 1, 2]])


@pytest.mark.parametrize(
    "text",
    [
        "1_0",
        "0x10",
        "1,5",
        "one",
        "1 2",
        "#",
        "1.5.2",
        "1\x1c",
        "1\xa0",
        "\N{ARABIC-INDIC DIGIT ONE}",
    ],
)
def test_texts_that_are_no_numbers(tmp_path, text):
    (tmp_path / "a.pcd").write_bytes(encoded(FIELDS, [([text], [1], [2])], "ascii"))
    with pytest.raises(BrokenScanError, match=r"line 1 after its header reads .* not 3 numbers"):
        read_pcd(tmp_path / "a.pcd")


@pytest.mark.parametrize("pages", [0, 4096, 8192, 65536])
def test_old_binary_files_end_with_a_page_of_zeros(tmp_path, pages):
    """As the Point Cloud Library wrote them: a page and the points long, whatever the header."""
    for data in ("binary", "binary_compressed"):
        whole = encoded(FIELDS, ROWS, data)
        start = whole.index(b"DATA ") + len(f"DATA {data}\n")
        padding = bytes(pages - start if pages else 0)
        (tmp_path / "a.pcd").write_bytes(whole + padding)
        np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd"), POINTS)
        for more in (b"\0", b"\1" if pages else b"\0\0"):
            wrong = padding[:-1] + more if pages and more == b"\1" else padding + more
            (tmp_path / "a.pcd").write_bytes(whole + wrong)
            with pytest.raises(BrokenScanError, match="bytes"):
                read_pcd(tmp_path / "a.pcd")


def test_padding_is_left_out_of_compressed_points_or_not(tmp_path):
    """The library leaves fields "_" out of them, other programs do not; the size tells."""
    rows = [(*row[:1], [1, 2, 3], *row[1:]) for row in ROWS]
    fields = [FIELDS[0], ("_", ("U", 1), 3), *FIELDS[1:]]
    (tmp_path / "with.pcd").write_bytes(encoded(fields, rows, "binary_compressed"))
    lines = {
        **{"FIELDS": "x _ y z", "SIZE": "4 1 4 4", "TYPE": "F U F F", "COUNT": "1 3 1 1"},
    }
    (tmp_path / "out.pcd").write_bytes(encoded(FIELDS, ROWS, "binary_compressed", lines=lines))
    for name in ("with", "out"):
        np.testing.assert_array_equal(read_pcd(tmp_path / f"{name}.pcd"), POINTS)


def test_what_would_take_memory_is_refused_before(tmp_path, monkeypatch):
    monkeypatch.setattr(pcd.np, "empty", lambda *_, **__: pytest.fail("memory was taken"))
    n = 120_000_000  # 1.4 GB of zeros in some kilobytes
    head = encoded(FIELDS, [], "binary_compressed", lines={"WIDTH": n, "POINTS": n})[:-8]
    small = bytes([0, 0]) + b"\xe0\xff\x00" * 4000
    (tmp_path / "a.pcd").write_bytes(head + struct.pack("<II", len(small), 12 * n) + small)
    with pytest.raises(BrokenScanError, match="1440000000 bytes of points in 12002 bytes"):
        read_pcd(tmp_path / "a.pcd")
    for data in ("ascii", "binary"):
        whole = encoded(FIELDS, ROWS, data, lines={"WIDTH": 10**15, "POINTS": 10**15})
        (tmp_path / "a.pcd").write_bytes(whole)
        with pytest.raises(BrokenScanError, match=r"600 (lines|records) for 10{15} points"):
            read_pcd(tmp_path / "a.pcd")


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ({"FIELDS": "x y"}, r"3 values of TYPE for 2 FIELDS"),
        ({"FIELDS": "x y x"}, "fields x y x: x twice"),
        ({"FIELDS": "x y Y"}, "fields x y Y: no z"),
        ({"FIELDS": "a b c"}, "fields a b c: no x, expected x, y and z once each"),
        ({"FIELDS": None}, "a header without a line FIELDS"),
        ({"COUNT": "1 1 2"}, "COUNT 2 of field z, not 1"),
        ({"COUNT": "1 1 0"}, "COUNT 0 of field z"),
        ({"COUNT": "1 1 -1"}, "the header line COUNT '1 1 -1'"),
        ({"SIZE": "4 4 3"}, "TYPE F with SIZE 3 of field z"),
        ({"SIZE": "4 4 8"}, "450 records for 600 points"),
        ({"TYPE": "F F S"}, "TYPE S with SIZE 4 of field z"),
        ({"WIDTH": 599}, "WIDTH 599 and HEIGHT 1 in its header, but POINTS 600"),
        ({"HEIGHT": 2}, "WIDTH 600 and HEIGHT 2 in its header, but POINTS 600"),
        ({"WIDTH": 599, "POINTS": 599}, "12 bytes more than 599 points of 12 bytes"),
        ({"WIDTH": 601, "POINTS": 601}, "600 records for 601 points in its header"),
        ({"WIDTH": None}, "a header without a line WIDTH"),
        ({"POINTS": "1_0"}, "the header line POINTS '1_0'"),
        ({"POINTS": "600\nPOINTS 600"}, "two header lines POINTS"),
        ({"VIEWPOINT": "0 0 0 1 0 0 \xb2"}, "the header line 'VIEWPOINT 0 0 0 1"),
        ({"UNIT": "mm"}, "the header line 'UNIT mm'"),
    ],
    ids=str,
)
def test_what_is_wrong_is_said(tmp_path, lines, words):
    (tmp_path / "a.pcd").write_bytes(encoded(FIELDS, ROWS, "binary", lines=lines))
    with pytest.raises(BrokenScanError, match=rf"^scan \S+a\.pcd: {words}[^\n]*PCD file$"):
        read_scan(tmp_path / "a.pcd")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "0 bytes, an empty file"),
        (b"#", "a header without a line DATA"),
        (b"\x89PNG\r\n\x1a\n\0\0", "the header line"),
        (encoded(FIELDS, ROWS, "binary").replace(b"DATA binary", b"DATA zip"), "DATA zip, not"),
        (encoded(FIELDS, ROWS, "binary_compressed")[:-1], r"\d+ bytes of compressed points, not"),
        (encoded(FIELDS, [], "binary"), "no points; expected at least one"),
        (
            encoded([*FIELDS[:2], ("z", ("U", 1), 1)], [([1], [2], [300])], "ascii"),
            "a coordinate 300 in a field of type uint8",
        ),
        (
            encoded([*FIELDS[:2], ("z", ("I", 4), 1)], [([1], [2], [1.5])], "ascii"),
            "a coordinate 1.5 in a field of type int32",
        ),
    ],
)
def test_other_files_are_refused(tmp_path, content, words):
    (tmp_path / "a.pcd").write_bytes(content)
    with pytest.raises(BrokenScanError, match=rf"a\.pcd: {words}"):
        read_scan(tmp_path / "a.pcd")
