"""Every command in every encoding, with outputs that are closed, full, or that nobody reads."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.cli.commands import COMMANDS
from deepring.cli.output_streams import PLAIN, ascii_form
from helpers.cli import DEEPRING, SMALL, deepring

ENCODINGS = ("ascii", "latin-1", "cp1252", "shift_jis", "utf-16", "utf-8")


@given(st.characters(codec=None))
def test_every_character_has_a_form_in_ascii(character):
    form = ascii_form(character)
    assert form.isascii()
    assert form
    assert form == character or not character.isascii()


def test_what_the_package_prints_has_a_usual_spelling():
    assert "".join(map(ascii_form, "θ ω τ π Δ")) == "theta omega tau pi Delta"
    assert "".join(map(ascii_form, "45° ± 2 × 3² …")) == "45deg +/- 2 x 32 ..."
    assert "".join(map(ascii_form, "┏━┓│ • café Å")) == "+-+| * cafe A"
    assert "".join(map(ascii_form, "中 😀 \udcff")) == r"\u4e2d \U0001f600 \xff"


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_what_an_encoding_has_is_left_as_it_is(encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors=PLAIN)
    stream.write("é θ 中 °")
    stream.flush()
    shown = stream.buffer.getvalue().decode(encoding)
    for character in "éθ中°":
        try:
            character.encode(encoding)
        except UnicodeEncodeError:
            assert ascii_form(character) in shown
        else:
            assert character in shown


def test_every_help_text_is_printed_in_ascii(tmp_path):
    for name in COMMANDS:
        done = deepring(name, "--help", cwd=tmp_path, encoding="ascii")
        assert done.returncode == 0
        assert not done.stderr
        assert len(done.stdout) > 200
    export = deepring("export", "--help", cwd=tmp_path, encoding="ascii").stdout
    assert "(batch, theta, omega)" in " ".join(export.split())


def test_a_training_and_its_tables_are_printed_in_ascii(tiny_nclt, tmp_path):
    others = [f"methods.{name}=null" for name in ("ring", "scan_context", "scan_context_120")]
    small = [*SMALL, *others, f"data.root={tiny_nclt}", "evaluation.figures=false"]
    done = deepring("train", "experiment=demo", *small, cwd=tmp_path, encoding="ascii")
    assert done.returncode == 0, done.stderr
    assert "epoch 1/1: train/loss" in done.stderr
    assert "Recall@1" in done.stdout
    done = deepring("tables", "outputs/demo/latest", cwd=tmp_path, encoding="ascii")
    assert done.returncode == 0, done.stderr
    assert "SG" in done.stdout


def test_a_map_is_built_and_searched_in_ascii(tiny_nclt, tmp_path):
    name = "[b] :smile: é.map"
    options = ["--session", "2031-02-04", "--spacing", 20, "-o", name]
    done = deepring("map", "build", tiny_nclt, *options, cwd=tmp_path, encoding="ascii")
    assert done.returncode == 0, done.stderr
    assert "map          [b] :smile: e.map" in done.stdout  # and no markup of the console
    scan = os.fsdecode(os.fsencode(tmp_path) + b"/a\xff.bin")
    Path(scan).write_bytes(next(tiny_nclt.rglob("velodyne_sync/*.bin")).read_bytes())
    options = [scan, "--format", "nclt"]
    done = deepring("localize", name, *options, cwd=tmp_path, encoding="ascii")
    assert done.returncode == 0, done.stderr
    assert "yaw deg" in done.stdout
    assert r"a\udcff" in done.stdout


def shell(script, cwd, **environment):
    return subprocess.run(
        ["sh", "-c", script],
        env={**os.environ, **environment, "DEEPRING": DEEPRING},
        cwd=cwd,
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize(
    "redirection", [">&-", "2>&-", "<&- >&- 2>&-", "2>/dev/full", "| true", "2>&1 | true"]
)
def test_output_that_goes_nowhere_is_no_error(redirection, tmp_path):
    done = shell(f'"$DEEPRING" --help {redirection}', tmp_path)
    assert done.returncode == 0
    assert not done.stderr


def test_the_work_is_done_although_nobody_reads_what_is_printed(tmp_path):
    script = """
import sys
from deepring.cli.output_streams import open_streams
open_streams()
for k in range(100_000):
    print("a line of output", flush=k % 100 == 0)
open("done", "w", encoding="utf-8").close()
"""
    done = shell(f"'{sys.executable}' -c '{script}' | head -1", tmp_path)
    assert done.stdout == b"a line of output\n"
    assert not done.stderr
    assert (tmp_path / "done").is_file()


def test_output_that_cannot_be_written_is_one_error(tmp_path):
    done = shell('"$DEEPRING" --help > /dev/full', tmp_path)
    assert done.returncode == 2
    assert done.stderr == b"error: no space is left on the disk\n"


def test_a_closed_output_is_not_the_next_file(tmp_path):
    script = """
import os
from deepring.cli.output_streams import open_streams
open_streams()
with open("a.map", "w", encoding="utf-8"):
    os.write(1, b"printed by C code")
"""
    assert shell(f"'{sys.executable}' -c '{script}' >&-", tmp_path).returncode == 0
    assert (tmp_path / "a.map").stat().st_size == 0


def test_a_mistake_is_told_in_the_encoding_of_the_c_locale(tmp_path):
    plain = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"}
    done = shell('"$DEEPRING" map info "nö/ a\n\x1bb.map"', tmp_path, **plain)
    assert done.returncode == 2
    assert done.stderr.isascii()
    assert done.stderr.count(b"\n") == 1
    assert b"n\\udcc3\\udcb6/ a\\n\\x1bb.map: no such file" in done.stderr
