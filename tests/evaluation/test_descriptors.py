"""Descriptors survive the file, and a file that is not what was written is refused."""

import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from safetensors.numpy import load_file, save_file

from deepring.errors import DeepringError, FileError
from deepring.evaluation.case import Case
from deepring.evaluation.descriptors import (
    DescriptorSet,
    file_name,
    free_path,
    read_descriptors,
    write_descriptors,
)
from deepring.rasters import BevRaster
from helpers.sealed_files import rewritten

MADE_BY = {"class": "deepring.methods.ring.Ring", "raster": {"kind": "bev", "height": (0, 1.5)}}


def example(n=4, **changes):
    rng = np.random.default_rng(n)
    values = {
        "descriptors": rng.normal(size=(n, 3, 2)).astype(np.float32),
        "positions": rng.normal(size=(n, 2)) + 4037591.0,
        "indices": np.arange(n) * 7,
        "case": Case("RING", "", "sim", "test"),
        "side": "query",
        "session": "2031-02-04",
        "made_by": MADE_BY,
        "ground_z": -1.9,
        "seconds_per_scan": 0.004,
    }
    return DescriptorSet(**{**values, **changes})


def assert_same(ours, theirs):
    for field in fields(DescriptorSet):
        a, b = (getattr(one, field.name) for one in (ours, theirs))
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            assert a.tobytes() == b.tobytes()
        else:
            assert a == b, field.name


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("descriptors")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "some.safetensors"


names = st.text(st.characters(exclude_categories=["C", "Z"], include_characters=" "), max_size=12)
finite = st.floats(allow_nan=False, allow_infinity=False)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63) + 1, 2**63 - 1) | finite | names,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=6,
)


@st.composite
def any_descriptors(draw):
    n = draw(st.integers(1, 5))
    rest = draw(st.lists(st.integers(1, 3), max_size=3))
    width32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
    turned = draw(st.booleans())
    return DescriptorSet(
        descriptors=draw(arrays.arrays(np.float32, (n, *rest), elements=width32)),
        positions=draw(arrays.arrays(np.float64, (n, 2), elements=st.floats(-1e12, 1e12))),
        indices=draw(arrays.arrays(np.int64, n)),
        turns=draw(arrays.arrays(np.float64, n, elements=finite)) if turned else None,
        case=Case(*(draw(names) for _ in range(4))),
        session=draw(names),
        side=draw(st.sampled_from(["database", "query"])),
        made_by=draw(st.dictionaries(names, plain, max_size=4)),
        ground_z=draw(finite),
        seconds_per_scan=draw(st.floats(0, allow_infinity=False)),
    )


@settings(max_examples=50, deadline=None)
@given(any_descriptors())
def test_round_trip_is_exact(folder, descriptors):
    write_descriptors(folder / "some.safetensors", descriptors)
    assert_same(read_descriptors(folder / "some.safetensors"), descriptors)


def test_arrays_in_any_order_in_memory_are_written_as_they_read(path):
    turned = np.asfortranarray(example().descriptors)[::-1]
    turned.flags.writeable = False
    write_descriptors(path, example(descriptors=turned))
    assert np.array_equal(read_descriptors(path).descriptors, turned)


def test_the_header_is_plain_text_that_other_tools_can_read(path):
    write_descriptors(path, example(turns=np.arange(4.0)))
    length = int.from_bytes(path.read_bytes()[:8], "little")
    metadata = json.loads(path.read_bytes()[8 : 8 + length])["__metadata__"]
    header = json.loads(metadata["deepring_sealed"].splitlines()[1])
    assert (header["kind"], header["version"]) == ("descriptors", 2)
    header = header["values"]
    assert (header["side"], header["session"]) == ("query", "2031-02-04")
    assert header["made_by"]["raster"] == {"kind": "bev", "height": [0, 1.5]}
    assert set(load_file(path)) == {"descriptors", "positions", "indices", "turns"}


def test_the_same_descriptors_make_the_same_bytes_and_replace_a_file(path):
    write_descriptors(path, example(n=9))
    write_descriptors(path, example())
    first = path.read_bytes()
    write_descriptors(path, example())
    assert path.read_bytes() == first
    assert list(path.parent.iterdir()) == [path]


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DeepringError, match="expected a writable path"):
        write_descriptors(tmp_path / "file" / "some.safetensors", example())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"side": "both"}, "side: 'both', expected one of database, query"),
        ({"session": "two\nlines"}, r"session: 'two\\nlines', expected text without control"),
        ({"ground_z": math.nan}, "ground_z: nan, expected a finite number of metres"),
        ({"seconds_per_scan": -1.0}, r"seconds_per_scan: -1\.0, expected .* at least 0"),
        ({"descriptors": np.zeros((4, 2))}, "tensor descriptors: float64 of .* expected float32"),
        (
            {"positions": np.zeros((3, 2))},
            r"tensor positions: .* of shape \(3, 2\), expected .* \(n, 2\), n = 4",
        ),
        ({"indices": np.arange(5)}, r"tensor indices: .* of shape \(5,\), expected .* n = 4"),
        ({"turns": np.zeros(2)}, r"tensor turns: .* of shape \(2,\), expected .* n = 4"),
        ({"positions": np.full((4, 2), np.inf)}, "query: positions: 8 of 8 values are not finite"),
        ({"turns": np.array([0, 0, np.nan, 0])}, "turns: 1 of 4 values are not finite"),
        ({"made_by": {"raster": BevRaster}}, "made_by: .*, expected plain values"),
        ({"made_by": ["ring"]}, r"made_by: \['ring'\], expected a dict"),
    ],
)
def test_what_cannot_be_descriptors_is_named(changes, message):
    with pytest.raises(DeepringError, match=message):
        example(**changes)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_descriptors_that_are_not_finite_are_refused(value):
    values = example().descriptors.copy()
    values[2, 1, 0] = value
    with pytest.raises(DeepringError, match=r"descriptors: 1 of 24 values are not finite"):
        example(descriptors=values)


@pytest.mark.parametrize(
    ("side", "message"), [("database", "holds 0 places"), ("query", "holds 0 scans")]
)
def test_an_empty_set_is_refused(side, message):
    with pytest.raises(DeepringError, match=f"sim, region test: the {side} {message}"):
        example(n=0, side=side)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(DeepringError, match=r"none\.safetensors: no such file; expected"):
        read_descriptors(tmp_path / "none.safetensors")
    with pytest.raises(DeepringError, match="is a folder; expected descriptors"):
        read_descriptors(tmp_path)


@pytest.mark.parametrize("content", [b"", b"\x00" * 200, b"method,train,test\n" * 9])
def test_another_kind_of_file_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(DeepringError, match="expected descriptors as"):
        read_descriptors(path)


def test_safetensors_of_something_else_are_refused(path):
    save_file({"weight": np.zeros(3, np.float32)}, path, metadata={"format": "pt"})
    with pytest.raises(DeepringError, match="a safetensors file that deepring did not write"):
        read_descriptors(path)


def test_a_file_cut_short_anywhere_is_refused(path):
    write_descriptors(path, example())
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 13), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(DeepringError, match=r"some\.safetensors: .*expected"):
            read_descriptors(path)
    path.write_bytes(whole + b"\x00")
    with pytest.raises(DeepringError, match="cut short or altered"):
        read_descriptors(path)


def test_an_altered_byte_anywhere_is_refused(path):
    write_descriptors(path, example())
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for place in range(len(whole)):
        altered = bytearray(whole)
        altered[place] ^= 1 << rng.integers(8)
        path.write_bytes(altered)
        with pytest.raises(DeepringError, match=r"some\.safetensors: "):
            read_descriptors(path)


def test_an_altered_value_and_an_altered_label_are_told(path):
    write_descriptors(path, example())
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(FileError, match=r"tensor .* was altered; expected .* export them again"):
        read_descriptors(path)
    path.write_bytes(whole.replace(b"RING", b"RUNG"))
    with pytest.raises(FileError, match="its header was altered"):
        read_descriptors(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stated": {"version": 1}}, "format version 1, expected 2; export them again"),
        ({"stated": {"kind": "map"}}, "a file of kind 'map'; expected descriptors as"),
        ({"values": {"side": "both"}}, "side: 'both', expected one of database, query"),
        ({"values": {"seconds_per_scan": -1}}, "seconds_per_scan: -1"),
        ({"values": {"made_by": "RING"}}, "made_by: 'RING', expected values by name"),
        ({"values": {"extra": 1}}, r"header\.extra: unknown"),
        ({"lacking": ["made_by"]}, "lacks made_by"),
        ({"lacking": ["positions"]}, "lacks positions"),
        ({"tensors": {"positions": torch.zeros(3, 2).double()}}, r"positions: .* \(3, 2\)"),
        ({"tensors": {"positions": torch.zeros(4, 2)}}, "positions: float32"),
        (
            {"tensors": {"turns": torch.full((4,), torch.nan).double()}},
            "turns: values that are not finite",
        ),
        ({"tensors": {"descriptors": torch.zeros(0, 2)}}, "positions: .* n = 0"),
        ({"tensors": {"descriptors": torch.zeros(())}}, r"descriptors: .* shape \(\)"),
    ],
)
def test_contents_that_cannot_be_right_are_refused(path, change, message):
    write_descriptors(path, example())
    rewritten(path, **change)
    with pytest.raises(FileError, match=message) as raised:
        read_descriptors(path)
    assert str(raised.value).startswith(f"descriptors {path}: ")
    assert "export them again" in str(raised.value) or "choose such a file" in str(raised.value)


def test_files_of_earlier_versions_are_refused(path):
    for text in ('{"version": 1, "checksum": "00"}', "{"):
        save_file({"x": np.zeros(1)}, path, metadata={"deepring": text})
        with pytest.raises(FileError, match=r"by an earlier version.*; export them again"):
            read_descriptors(path)


def test_file_names_tell_method_test_region_and_side():
    assert file_name(example().case, "query") == "RING__sim__test__query.safetensors"
    case = Case("Scan Context 20x60", "", "sim_nclt", "../whole")
    expected = "Scan_Context_20x60__sim_nclt___whole__database.safetensors"
    assert file_name(case, "database") == expected


def test_a_file_makes_way_for_one_of_the_same_case_alone(tmp_path):
    ours = example(case=Case("Scan Context", "", "sim", "test"))
    path = free_path(tmp_path, ours.case, "query")
    assert path == tmp_path / "Scan_Context__sim__test__query.safetensors"
    write_descriptors(path, ours)
    assert free_path(tmp_path, ours.case, "query") == path
    for changes in ({"method": "Scan/Context"}, {"train": "city"}):
        with pytest.raises(DeepringError, match=r"query\.safetensors: holds the descriptors of"):
            free_path(tmp_path, replace(ours.case, **changes), "query")
    path.write_text("precious")
    with pytest.raises(DeepringError, match=r"or delete it: descriptors are written to this path"):
        free_path(tmp_path, ours.case, "query")
    assert path.read_text() == "precious"


def test_places_beyond_any_world_are_refused():
    with pytest.raises(DeepringError, match=r"positions: 1e\+300 metres .* at most 1e\+12"):
        example(positions=np.full((4, 2), 1e300))
