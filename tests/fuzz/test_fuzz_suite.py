"""The suite notices every kind of fault, repeats itself, and its decoders read the good files."""

import io
import json
import logging
import random
import re
import zipfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader

from deepring.errors import DataError
from fuzz import planted, report
from fuzz.__main__ import main
from fuzz.decoders import lzf, mcap, sealed
from fuzz.files import UndecodableError
from fuzz.formats import every_format
from fuzz.inputs import Bench, Name, mutated, names
from fuzz.limits import Limits
from fuzz.mutations.sealed import forged_tensors, forged_values, parts_of, put_together
from fuzz.mutations.zips import zip_entries
from fuzz.outcomes import message_fault, same
from fuzz.processes import run_all
from helpers.bags import START, describe

FORMATS = {format.name: format for format in every_format()}
#: Inputs of each format with the default tests; `make fuzz` runs thousands.
FEW = 8

by_format = pytest.mark.parametrize("name", FORMATS)


@pytest.fixture(scope="module")
def bench_of(tmp_path_factory):
    benches = {}

    def bench(name):
        if name not in benches:
            folder = tmp_path_factory.mktemp("fuzz") / "files"
            benches[name] = Bench(FORMATS[name], folder)
        return benches[name]

    return bench


@by_format
def test_inputs_follow_from_their_names_and_decoders_read_the_good_files(bench_of, name):
    bench = bench_of(name)
    if bench.format.decode is not None:
        assert same(bench.value, bench.format.decode(bench.good))
    inputs = [mutated(bench.format, Name(name, 0, k), bench.good) for k in range(6)]
    again = [mutated(bench.format, Name(name, 0, k), bench.good) for k in range(6)]
    assert inputs == again
    assert any(files != bench.good for files, _ in inputs)
    assert inputs != [mutated(bench.format, Name(name, 1, k), bench.good) for k in range(6)]


@by_format
def test_a_few_inputs_of_each_format_are_read_right_or_refused(bench_of, name, caplog):
    caplog.set_level(logging.CRITICAL)  # a cache says that it is made anew
    bench = bench_of(name)
    results = [(one, *bench.run(one)) for one in (Name(name, 0, k) for k in range(FEW))]
    assert not report.bad(results), f"make fuzz runs more of them:\n{report.faults(results)}"


def test_planted_faults_are_noticed(tmp_path):
    formats = list(planted.every_format())
    inputs = list(names(formats, 0, len(formats)))
    limits = Limits(seconds=0.3, bytes=64 << 20)
    results = list(run_all("fuzz.planted", inputs, tmp_path, limits, processes=1))
    kinds = {name.format: outcome.kind for name, outcome, _ in results}
    assert kinds == {f.name: re.split(" of | with |,", f.name)[0] for f in formats}


def test_a_fault_is_exit_status_1_and_is_named(capsys):
    one = ["--processes", "1", "--inputs", "1", "--formats"]
    assert main([*one, "exception"], "fuzz.planted") == 1
    said = capsys.readouterr().out
    assert "1 bad of 1" in said
    assert "KeyError" in said
    assert "exception:0:0" in said
    assert main([*one, "refused", "right"], "fuzz.planted") == 0
    assert main(["--input", "exception:0:0"], "fuzz.planted") == 1
    assert main(["--input", "refused:0:0"], "fuzz.planted") == 0


def test_an_input_does_not_change_with_the_number_of_inputs():
    formats = list(FORMATS.values())
    few, many = (list(names(formats, 3, count)) for count in (500, 5000))
    assert set(few) <= set(many)
    assert abs(len(many) - 5000) < 50
    assert {name.format for name in few} == set(FORMATS)
    assert Name.parse(str(few[-1])) == few[-1]


def test_forged_files_have_right_digests(bench_of):
    good = bench_of("map int8").good
    stated, tensors = parts_of(good["a.map"])
    assert parts_of(put_together(text_of(good["a.map"]), tensors)) == (stated, tensors)
    for forge in (forged_values("a.map"), forged_tensors("a.map")):
        read = 0
        for seed in range(30):
            files = dict(good)
            forge(random.Random(seed), files)
            problem = problem_of(files["a.map"])
            read += problem == ""
            assert "digest" not in problem
        assert read > 15
    broken = bytearray(good["a.map"])
    broken[-1] ^= 1
    with pytest.raises(UndecodableError, match="a tensor other than"):
        sealed.decode(bytes(broken), "map")


def problem_of(content):
    """What the decoder says of a map, or ''."""
    try:
        sealed.decode(content, "map")
    except UndecodableError as error:
        return str(error)
    return ""


def text_of(content):
    """The header text of a sealed file."""
    size = int.from_bytes(content[:8], "little")
    metadata = json.loads(content[8 : 8 + size])["__metadata__"]
    return metadata["deepring_sealed"].partition("\n")[2]


def test_forged_checkpoints_have_right_checksums(bench_of):
    good = bench_of("checkpoint").good
    for seed in range(20):
        files = dict(good)
        zip_entries("n.ckpt")(random.Random(seed), files)
        with zipfile.ZipFile(io.BytesIO(files["n.ckpt"])) as parts:
            assert parts.testzip() is None


def test_mcap_files_are_those_that_a_library_reads(bench_of, tmp_path):
    content = bench_of("bag mcap with checksums").good["a.mcap"]
    (tmp_path / "a.mcap").write_bytes(content)
    describe(tmp_path / "a.mcap", START, 6)
    with Reader(tmp_path) as bag:
        assert [time for _, time, _ in bag.messages()] == [START + k * 10**8 for k in range(6)]
    altered = content.replace(b"lidar", b"radar", 1)
    with pytest.raises(UndecodableError, match="checksum"):
        mcap.decode(altered)


@settings(deadline=None, derandomize=True)
@given(st.binary(max_size=600), st.integers(1, 40))
def test_lzf_streams_are_whole(content, times):
    content = content * times
    packed = lzf.compress(content)
    assert lzf.decompress(packed, len(content)) == content
    for size in (len(content) + 1, max(0, len(content) - 1)):
        if size != len(content):
            with pytest.raises(UndecodableError):
                lzf.decompress(packed, size)


def test_lzf_as_its_definition_has_it():
    # A run of one, and a reference of nine bytes to one byte before: ten times the same.
    assert lzf.decompress(bytes([0, 65, 0xE0, 0, 0]), 10) == b"A" * 10


def test_numbers_are_compared_up_to_rounding():
    assert same({"a": [1.0, float("nan")]}, {"a": (1.0 + 1e-12, float("nan"))})
    for a, b in (([1.0], [1.1]), ([1], [1, 2]), ({"a": 1}, {"b": 1}), ("a", "b"), (1.0, None)):
        assert not same(a, b)


def test_a_refusal_of_one_line_that_names_the_file_is_right(tmp_path):
    assert message_fault(DataError(f"{tmp_path}/a.bin: 3 bytes, expected 16"), tmp_path) is None
    assert message_fault(DataError("a.bin: 3 bytes"), None) is None
    assert "characters" in message_fault(DataError(f"{tmp_path}: {'x' * 2000}"), tmp_path)
