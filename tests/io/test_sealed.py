"""Sealed files: what is written comes back, and whatever else is a FileError and nothing else."""

import json
from dataclasses import dataclass, replace
from typing import Any, Literal

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import save_file

from deepring.errors import ConfigError, DataError, FileError
from deepring.io.sealed import SealedFormat, open_sealed, write_sealed
from deepring.io.tensor_types import TensorType
from helpers.sealed_files import entry_of, parts_of, put_together, rewritten


@dataclass(frozen=True)
class Header:
    name: str
    scale: float
    mode: Literal["a", "b"]
    shape: tuple[int, int] | None
    free: dict[str, Any]


FORMAT = SealedFormat(
    "box",
    4,
    Header,
    {
        "rows": TensorType("float32", ("n", 2)),
        "ids": TensorType(("int64", "int32"), ("n",)),
        "tail": TensorType("uint8", ("n", ...), optional=True),
        "free.*": None,
    },
    description="a box as these tests write it",
    remedy="pack it again",
)
OTHER = replace(FORMAT, kind="crate", description="a crate")
HEADER = Header("one", 0.5, "a", (3, 2), {"x": [1, None]})


def tensors_of(n=3):
    return {
        "rows": torch.arange(2.0 * n).view(n, 2),
        "ids": torch.arange(n),
        "tail": torch.ones(n, 3, 1, dtype=torch.uint8),
        "free.bias": torch.full((2, 2), 0.5, dtype=torch.bfloat16),
    }


@pytest.fixture
def box(tmp_path):
    write_sealed(tmp_path / "a.box", FORMAT, HEADER, tensors_of())
    return tmp_path / "a.box"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("boxes")


@pytest.fixture(scope="module")
def whole(folder):
    """The bytes of a box."""
    write_sealed(folder / "whole.box", FORMAT, HEADER, tensors_of())
    return (folder / "whole.box").read_bytes()


def refuse(path, message=None, format=FORMAT):
    """A FileError that begins with kind and file and ends with what to do."""
    with pytest.raises(FileError, match=message) as raised:
        open_sealed(path, format, check=True)
    text = str(raised.value)
    assert text.startswith(f"{format.kind} {path}: ")
    assert "; " in text
    assert (
        "pack it again" in text
        or "choose such a file" in text
        or " file; " in text
        or " folder; " in text
    )
    for foreign in ("Error", "HeaderTooLarge", "column", "char ", "Traceback", "invalid"):
        assert foreign not in text
    return text


FINITE = st.floats(allow_nan=False, allow_infinity=False)
WHOLE = st.integers(-(2**63) + 1, 2**63 - 1)
names = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
headers = st.builds(
    Header,
    names,
    FINITE,
    st.sampled_from("ab"),
    st.none() | st.tuples(WHOLE, WHOLE),
    st.dictionaries(names, st.none() | WHOLE | names, max_size=3),
)


@settings(deadline=None, max_examples=50)
@given(headers, st.integers(0, 4))
def test_what_is_written_comes_back(folder, header, n):
    tensors = tensors_of(n)
    digest = write_sealed(folder / "some.box", FORMAT, header, tensors)
    opened = open_sealed(folder / "some.box", FORMAT, check=True)
    assert opened.header == header
    assert opened.digest == digest
    assert set(opened.tensors) == set(tensors)
    for name, tensor in tensors.items():
        assert opened.tensors[name].dtype == tensor.dtype
        assert torch.equal(opened.tensors[name], tensor)


def test_equal_contents_make_equal_bytes_and_digests(box, tmp_path):
    backwards = dict(reversed(tensors_of().items()))
    digest = write_sealed(tmp_path / "b.box", FORMAT, HEADER, backwards)
    assert (tmp_path / "b.box").read_bytes() == box.read_bytes()
    assert open_sealed(box, FORMAT).digest == digest
    changed = {**backwards, "ids": torch.tensor([0, 1, 3])}
    assert write_sealed(tmp_path / "c.box", FORMAT, HEADER, changed) != digest
    assert write_sealed(tmp_path / "d.box", FORMAT, replace(HEADER, name="x"), backwards) != digest


def test_other_tools_can_read_the_header(box):
    content = box.read_bytes()
    length = int.from_bytes(content[:8], "little")
    metadata = json.loads(content[8 : 8 + length])["__metadata__"]
    header = json.loads(metadata["deepring_sealed"].splitlines()[1])
    assert (header["kind"], header["version"]) == ("box", 4)
    assert header["values"]["shape"] == [3, 2]
    assert header["tensors"]["ids"] == entry_of(torch.arange(3))


def test_tensors_are_mapped_and_not_read(box):
    opened = open_sealed(box, FORMAT)
    rows = parts_of(box)[1]["rows"]
    content = box.read_bytes()
    with box.open("r+b") as file:  # the same file on disk, altered under the opened one
        file.seek(content.index(rows.numpy().tobytes()))
        file.write((rows + 7).numpy().tobytes())
    assert torch.equal(opened.tensors["rows"], rows + 7)
    # What is opened can be written to, which does not change the file.
    opened.tensors["rows"][0, 0] = 99.0
    assert torch.equal(open_sealed(box, FORMAT).tensors["rows"], rows + 7)


def test_non_contiguous_tensors_and_gradients_are_written_as_they_read(tmp_path):
    rows = torch.arange(6.0).view(2, 3).T.requires_grad_()
    write_sealed(tmp_path / "a.box", FORMAT, HEADER, {"rows": rows, "ids": torch.arange(3)})
    assert torch.equal(open_sealed(tmp_path / "a.box", FORMAT).tensors["rows"], rows)


# Files that are not what was written.


@settings(deadline=None, max_examples=150)
@given(data=st.data())
def test_a_file_cut_short_anywhere_is_refused(folder, whole, data):
    content = whole[: data.draw(st.integers(0, len(whole) - 1))]
    (folder / "cut.box").write_bytes(content)
    refuse(folder / "cut.box", "no complete safetensors file")


def test_a_file_cut_at_its_seams_is_refused(box):
    content = box.read_bytes()
    header = 8 + int.from_bytes(content[:8], "little")
    for length in (0, 1, 7, 8, 9, header - 1, header, header + 1, len(content) - 1):
        box.write_bytes(content[:length])
        refuse(box, "no complete safetensors file")
    box.write_bytes(content + b"\0")
    refuse(box, "no complete safetensors file")


def test_a_flipped_bit_in_any_byte_is_refused(folder, whole):
    for place in range(len(whole)):
        altered = bytearray(whole)
        altered[place] ^= 1 << place % 8
        (folder / "flipped.box").write_bytes(altered)
        refuse(folder / "flipped.box")


@settings(deadline=None, max_examples=150)
@given(data=st.data())
def test_overwritten_bytes_are_refused(folder, whole, data):
    start = data.draw(st.integers(0, len(whole) - 1))
    new = data.draw(st.binary(min_size=1, max_size=min(40, len(whole) - start)))
    altered = whole[:start] + new + whole[start + len(new) :]
    (folder / "over.box").write_bytes(altered)
    try:
        opened = open_sealed(folder / "over.box", FORMAT, check=True)
    except FileError:
        return
    # Nothing was changed, or spaces that fill the header up.
    assert opened.header == HEADER
    assert all(torch.equal(opened.tensors[k], v) for k, v in tensors_of().items())


@settings(deadline=None, max_examples=60)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused(folder, content):
    (folder / "any.box").write_bytes(content)
    refuse(folder / "any.box", "no complete safetensors file")


def test_bytes_of_tensors_are_read_where_it_is_asked_for(box):
    content = bytearray(box.read_bytes())
    content[-1] ^= 1
    box.write_bytes(content)
    opened = open_sealed(box, FORMAT)
    with pytest.raises(FileError, match=r"the tensor \w+ was altered; .*; copy it again, or pack"):
        opened.verify()


def test_swapped_tensors_of_equal_types_are_told_by_their_bytes(tmp_path):
    kind = TensorType("int64", ("n",))
    two = replace(FORMAT, tensors={"a": kind, "b": kind})
    a, b = torch.arange(3), torch.arange(3) + 1
    write_sealed(tmp_path / "a.box", two, HEADER, {"a": a, "b": b})
    stated, _ = parts_of(tmp_path / "a.box")
    put_together(tmp_path / "a.box", stated, {"a": b, "b": a})
    open_sealed(tmp_path / "a.box", two)
    refuse(tmp_path / "a.box", "the tensor a was altered", two)


def test_the_header_of_another_file_is_refused(box, tmp_path):
    write_sealed(tmp_path / "b.box", FORMAT, HEADER, tensors_of(4))
    stated, _ = parts_of(tmp_path / "b.box")
    put_together(box, stated, parts_of(box)[1])
    with pytest.raises(FileError, match="tensors differ from those in its header"):
        open_sealed(box, FORMAT)


def test_a_header_that_was_altered_is_told_at_once(box):
    content = box.read_bytes()
    box.write_bytes(content.replace(b"one", b"two"))
    with pytest.raises(FileError, match=r"its header was altered; expected .*; copy it again, or"):
        open_sealed(box, FORMAT)


def test_missing_files_folders_and_other_kinds_are_told(box, tmp_path):
    refuse(tmp_path / "none.box", "no such file; expected a box as these tests write it")
    refuse(tmp_path, "is a folder; expected a box")
    refuse(box, "a file of kind 'box'; expected a crate; choose such a file", OTHER)
    save_file({"x": torch.zeros(1)}, box, {"format": "pt"})
    refuse(box, "a safetensors file that deepring did not write; expected a box")
    save_file({"x": torch.zeros(1)}, box)
    refuse(box, "a safetensors file that deepring did not write")


@pytest.mark.parametrize("key", ["deepring", "deepring_map", "deepring_network", "deepring_index"])
def test_files_of_before_are_refused_with_what_to_do(box, key):
    save_file({"x": torch.zeros(1)}, box, {key: '{"version": 2}'})
    refuse(box, "by an earlier version of deepring; expected format version 4; pack it again")


@pytest.mark.parametrize("version", [3, 5, "4", None, True, [4]])
def test_other_versions_are_refused(box, version):
    rewritten(box, stated={"version": version})
    refuse(box, r"format version .*, expected 4; pack it again with this version of deepring")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "3",
        "null",
        '"kind"',
        "{}",
        '{"kind": "box"}',
        '{"kind": "box", "version": 4}',
        '{"kind": "box", "version": 4, "tensors": [], "values": {}}',
        '{"kind": "box", "version": 4, "tensors": {"rows": 3}, "values": {}}',
        '{"kind": "box", "version": 4, "tensors": {}, "values": []}',
        '{"kind": ["box"], "version": 4}',
        "[" * 100_000,
        '{"kind": "box", "version": ' + "9" * 10_000 + "}",
    ],
)
def test_whole_seals_of_nonsense_are_refused(box, text):
    put_together(box, text, parts_of(box)[1])
    refuse(box)


# Whole seals over contents that the format does not know.

plain = st.recursive(
    st.none() | st.booleans() | WHOLE | FINITE | st.text(max_size=5),
    lambda some: st.lists(some, max_size=3) | st.dictionaries(st.text(max_size=3), some),
    max_leaves=4,
)


def fits(name, value):
    """Whether a header's value is of its type, told another way than the reader does."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    integers = isinstance(value, list) and [type(one) for one in value] == [int, int]
    return {
        "name": isinstance(value, str),
        "scale": number,
        "mode": value in ("a", "b"),
        "shape": value is None or integers,
        "free": isinstance(value, dict),
    }[name]


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(["name", "scale", "mode", "shape", "free"]), plain)
def test_values_of_other_types_are_refused(folder, whole, name, value):
    path = folder / "values.box"
    path.write_bytes(whole)
    rewritten(path, values={name: value})
    if fits(name, value):
        open_sealed(path, FORMAT, check=True)
    else:
        refuse(path, rf"header\.{name}.*: .*, expected ")


DTYPES = [torch.float32, torch.float64, torch.int64, torch.int32, torch.uint8, torch.bool]


@settings(deadline=None, max_examples=150)
@given(
    st.sampled_from(["rows", "ids", "tail"]),
    st.sampled_from(DTYPES),
    st.lists(st.integers(0, 3), max_size=3),
)
def test_tensors_of_other_types_and_shapes_are_refused(folder, whole, name, dtype, shape):
    path = folder / "tensors.box"
    path.write_bytes(whole)
    rewritten(path, tensors={name: torch.zeros(shape, dtype=dtype)})
    right = {
        "rows": dtype == torch.float32 and shape == [3, 2],
        "ids": dtype in (torch.int64, torch.int32) and shape == [3],
        "tail": dtype == torch.uint8 and shape[:1] == [3],
    }[name]
    if right:
        open_sealed(path, FORMAT, check=True)
    else:
        refuse(path, r"tensor \w+: .* of shape .*, expected ")


@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
@pytest.mark.parametrize("name", ["rows", "free.bias"])
def test_values_that_are_not_finite_are_refused(box, name, value):
    tensor = parts_of(box)[1][name]
    tensor.view(-1)[-1] = value
    rewritten(box, tensors={name: tensor})
    refuse(box, rf"tensor {name}: values that are not finite, expected finite numbers")


def test_values_of_large_tensors_are_read_with_every_byte(tmp_path):
    large = TensorType("float32", ("n", 2), least=0, large=True)
    format = replace(FORMAT, tensors={**FORMAT.tensors, "rows": large})
    for value, message in (
        (torch.nan, "rows: values that are not finite"),
        (-1.0, "a value of -1"),
    ):
        tensors = {**tensors_of(), "rows": torch.full((3, 2), value)}
        write_sealed(tmp_path / "a.box", format, HEADER, tensors)
        open_sealed(tmp_path / "a.box", format)
        refuse(tmp_path / "a.box", message, format)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('"scale": NaN', "JSON: NaN, expected finite numbers"),
        ('"scale": 1e999', "JSON: '1e999', expected finite numbers"),
        ('"scale": 0.5, "scale": 0.5', "JSON: 'scale' twice"),
        ('"scale": ' + "9" * 30, "64 bits"),
        ('"scale": ' + "[" * 70 + "]" * 70, "nested too deeply"),
    ],
)
def test_headers_that_programs_read_in_several_ways_are_refused(box, text, message):
    stated, tensors = parts_of(box)
    put_together(box, json.dumps(stated).replace('"scale": 0.5', text), tensors)
    refuse(box, message)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_values_that_json_lacks_are_not_written(tmp_path, value):
    with pytest.raises(FileError, match=r"without a JSON form.*; nothing was written"):
        write_sealed(tmp_path / "a.box", FORMAT, replace(HEADER, scale=value), tensors_of())
    assert list(tmp_path.iterdir()) == []


@settings(deadline=None, max_examples=150)
@given(data=st.data())
def test_any_layout_of_the_tensors_is_refused_or_right(folder, whole, data):
    """The header of safetensors itself: names, types, shapes and offsets, all declared."""
    length = int.from_bytes(whole[:8], "little")
    entries, content = json.loads(whole[8 : 8 + length]), whole[8 + length :]
    name = data.draw(st.sampled_from(["rows", "ids", "tail", "free.bias"]))
    field, values = data.draw(
        st.sampled_from(
            [
                ("data_offsets", st.lists(st.sampled_from([0, 1, 24, 48, 2**63, -1]), max_size=3)),
                ("shape", st.lists(st.sampled_from([0, 1, 2, 3, 2**62, -1]), max_size=3)),
                ("dtype", st.sampled_from(["F32", "I64", "BOOL", "F8_E4M3", "U8", "x", ""])),
            ]
        )
    )
    entries[name][field] = data.draw(values)
    header = json.dumps(entries).encode()
    declared = data.draw(st.sampled_from([len(header), 2**40, len(header) + 1, 0]))
    path = folder / "layout.box"
    path.write_bytes(declared.to_bytes(8, "little") + header + content)
    try:
        opened = open_sealed(path, FORMAT, check=True)
    except FileError:
        return
    assert all(torch.equal(opened.tensors[k], v) for k, v in tensors_of().items())


def test_missing_and_unknown_names_are_told(box):
    rewritten(box, values={"more": 1}, lacking=["name", "mode"])
    refuse(box, r"header\.more: unknown, expected one of name, scale, mode, shape, free")
    rewritten(box, lacking=["more"])
    refuse(box, r"header: lacks name, mode; expected name, scale, mode, shape, free")
    rewritten(box, values={"name": "a", "mode": "a"}, lacking=["more", "rows", "ids"])
    refuse(box, r"tensors: lacks ids, rows; expected rows, ids, tail, free\.\*")
    rewritten(box, tensors={"more": torch.zeros(1), **tensors_of()}, lacking=["ids"])
    refuse(box, r"tensors: lacks ids and has an unknown more")
    rewritten(box, tensors={"ids": torch.arange(3)}, lacking=["more", "tail", "free.bias"])
    open_sealed(box, FORMAT, check=True)


# Writing.


def test_what_the_format_has_no_place_for_is_not_written(tmp_path):
    path = tmp_path / "a.box"
    for tensors, header in [
        ({"rows": torch.zeros(3, 2)}, HEADER),
        ({**tensors_of(), "ids": torch.zeros(3)}, HEADER),
        (tensors_of(), replace(HEADER, mode="c")),
        (tensors_of(), replace(HEADER, scale="big")),
        (tensors_of(), replace(HEADER, free={"x": torch.zeros(1)})),
    ]:
        with pytest.raises(FileError, match=r"a\.box: .*; nothing was written$"):
            write_sealed(path, FORMAT, header, tensors)
    assert list(tmp_path.iterdir()) == []


def test_a_path_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FileError, match="expected a writable path"):
        write_sealed(tmp_path / "file" / "a.box", FORMAT, HEADER, tensors_of())


def test_a_file_is_written_whole_with_usual_permissions(box, monkeypatch):
    (box.parent / "usual").touch()
    assert box.stat().st_mode == (box.parent / "usual").stat().st_mode
    before = box.read_bytes()

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("safetensors.torch.save_file", killed)
    with pytest.raises(KeyboardInterrupt):
        write_sealed(box, FORMAT, HEADER, tensors_of(5))
    assert box.read_bytes() == before
    assert {path.name for path in box.parent.iterdir()} == {"a.box", "usual"}


def test_a_file_that_is_open_can_be_replaced(box):
    opened = open_sealed(box, FORMAT)
    rows = opened.tensors["rows"].clone()
    changed = {**opened.tensors, "rows": opened.tensors["rows"] + 1}
    write_sealed(box, FORMAT, opened.header, changed)
    assert torch.equal(opened.tensors["rows"], rows)
    assert torch.equal(open_sealed(box, FORMAT, check=True).tensors["rows"], rows + 1)


def test_errors_about_contents_name_the_file(box):
    opened = open_sealed(box, FORMAT)
    for error in (ConfigError("scale: 0.5"), DataError("scale: 0.5"), FileError("scale: 0.5")):
        message = rf"^box {box}: scale: 0\.5; pack it again$"
        with pytest.raises(FileError, match=message), opened.contents():
            raise error
    for error in (FileError(f"box {box}: named"), ZeroDivisionError("no error of ours")):
        with pytest.raises(type(error), match=f"^{error}$"), opened.contents():
            raise error
