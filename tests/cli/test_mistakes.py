"""A mistake in the words of the command line: flags for arguments, plain words for errno."""

import errno
import re
import shlex
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.cli.mistakes import is_mistake, report_mistakes, with_flags
from deepring.cli.overrides import checked, quoted, value_of
from deepring.errors import ConfigError, DataError, StoppedError
from deepring.text import printable
from helpers.cli import deepring, refused

FLAGS = {"format": "--format", "ground_z": "--ground-z", "output": "-o"}


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("format: 'x', expected one of a, b", "--format: 'x', expected one of a, b"),
        ("format = 'x'; expected a", "--format = 'x'; expected a"),
        ("data.format: 'x', expected a", "--format: 'x', expected a"),
        ("a.bin: give its `format`, a or b", "a.bin: give its --format, a or b"),
        ("`output` and `ground_z`", "-o and --ground-z"),
        ("a.bin: of another format: b", "a.bin: of another format: b"),
        ("spacing: 1, expected a format: b", "spacing: 1, expected a format: b"),
        ("`spacing`: 1", "`spacing`: 1"),
    ],
)
def test_arguments_become_flags_and_nothing_else_does(message, shown):
    assert with_flags(message, FLAGS) == shown


def said(error, capsys):
    with pytest.raises(SystemExit) as ended, report_mistakes(FLAGS):
        raise error
    assert ended.value.code == 2
    captured = capsys.readouterr()
    assert not captured.out
    return captured.err


def test_our_errors_are_one_line(capsys):
    assert said(ConfigError("format: 'x'"), capsys) == "error: --format: 'x'\n"


def test_further_lines_of_an_error_of_ours_are_lines(capsys):
    error = DataError("a: no layout; one of:", lines=["  KITTI: b", "  NCLT:\n c"])
    assert said(error, capsys) == "error: a: no layout; one of:\n  KITTI: b\n  NCLT:\\n c\n"


def test_the_argument_that_an_error_asks_for_is_added_once(capsys):
    error = ConfigError("a.bin: not told what is in it", argument="format")
    assert said(error, capsys) == "error: a.bin: not told what is in it (--format)\n"
    error = ConfigError("format: 'x'", argument="format")
    assert said(error, capsys) == "error: --format: 'x'\n"
    error = ConfigError("a.bin: broken", argument="reader")
    assert said(error, capsys) == "error: a.bin: broken\n"


def test_the_system_s_errors_are_said_in_our_words(capsys):
    error = FileNotFoundError(errno.ENOENT, "No such file or directory", "a.map")
    assert said(error, capsys) == "error: a.map: no such file or folder\n"
    error = FileNotFoundError(errno.ENOENT, "No such file or directory", "")
    assert said(error, capsys) == "error: no such file or folder\n"
    error = OSError(errno.ENOSPC, "No space left on device")
    assert said(error, capsys) == "error: no space is left on the disk\n"


def test_an_interrupted_training_has_the_exit_status_of_ctrl_c(capsys):
    with pytest.raises(SystemExit) as ended, report_mistakes(FLAGS):
        raise StoppedError("training was interrupted; go on with resume=a.ckpt")
    assert ended.value.code == 130
    assert "resume=a.ckpt" in capsys.readouterr().err


def test_a_bug_keeps_its_traceback():
    for error in (ValueError("a bug"), KeyError("a bug"), TypeError("a bug")):
        assert not is_mistake(error)
        with pytest.raises(type(error)), report_mistakes(FLAGS):
            raise error


OVERRIDES = [
    # Values of a key
    ("seed=a", r"seed: a, expected a whole number"),
    ("seed=null", r"seed: null, expected a whole number"),
    ("seed=", r"seed=: no value, expected a whole number"),
    ("seed=99999999999", r"seed: 99999999999, expected a whole number up to 4294967295"),
    ("data.ground_z=up", r"data\.ground_z: up, expected a number or null"),
    ("data.ground_z=nan", r"data\.ground_z: nan, expected a finite number of metres"),
    ("data.spacing=5", r"data\.spacing: 5, expected values by name: database, query, train"),
    ("data.spacing.database=-1", r"data\.spacing\.database: -1\.0, expected .* of at least 0"),
    ("data.revisit_radius=inf", r"data\.revisit_radius: inf, expected a number of metres"),
    ("data.query_turn_seed=-4", r"data\.query_turn_seed: -4, expected a whole number"),
    ("data.root=", r"data\.root=: no value, expected text; 'data\.root=\"\"' gives an empty"),
    ("data.root=1e5", r"data\.root=1e5: would be read as .* 'data\.root=\"1e5\"'"),
    ("data.query=2012_01_08", r"data\.query=2012_01_08: would be read as the number 20120108, .*"),
    ("evaluate=maybe", r"evaluate: maybe, expected true or false"),
    ("evaluation.radii=ten", r"evaluation\.radii: ten, expected a list, as \[1, 2\]"),
    ("evaluation.radii=[a]", r"evaluation\.radii\[0\]: a, expected a number"),
    ("seed=${foo}", r"seed: \$\{foo\} refers to a key that the config lacks"),
    ("seed=${oc.env:NOPE}", r"seed: \$\{oc\.env:NOPE\} refers to a variable that is not set"),
    ("seed=${nope:1}", r"seed: \$\{nope:\.\.\.\} names no resolver"),
    ("experiment_name=${data.x}", r"hydra\.run\.dir: \$\{data\.x\} .*; see experiment_name=\$\{da"),
    # Keys
    ("method.encoder.wdths=[8]", r"method\.encoder\.wdths: no such key; .* has .*widths"),
    ("representation=polar_gram", r"representation: no such key; the config has .*method"),
    ("paths.roots.kitti2=/x", r"paths\.roots\.kitti2: no such key; paths\.roots has .*kitti"),
    ("data.foo=1", r"data\.foo: no such key; data has .*"),
    ("+data.foo=1", r"data\.foo: no such key; data has .*"),
    ("++foo.bar=1", r"foo: no such key; the config has .*"),
    ("~data.foo", r"~data\.foo: no such key; leave it out"),
    ("~seed=4", r"~seed=4: its value is 0, expected ~seed"),
    ("+seed=1", r"\+seed: the config has this key, expected seed=VALUE without the \+"),
    # Groups
    ("data=own", r"data: 'own', expected one of custom, .*nclt"),
    ("method=[a,b]", r"method: 'b', expected one of .*deepring, .*"),
    ("method=null", r"method=null: expected the name of an option of method; ~method chooses none"),
    ("method/representation=grm", r"method/representation: 'grm', expected one of polar_gram"),
    ("method/foo=1", r"method/foo: no such group"),
    ("~data=own", r"~data=own: not chosen; leave it out"),
    ("++data=nclt", r"\+\+data: a group, expected data=nclt without \+\+"),
    # Grammar
    ("seed", r"seed: no value, expected KEY=VALUE"),
    ("=x", r"'=x': no key, expected KEY=VALUE"),
    ("+=x", r"'\+=x': no key, expected KEY=VALUE"),
    ("a b=3", r"a b=3: cannot be read, expected KEY=VALUE with a KEY of names and dots"),
    ("x=[{a: [1", r"x=\[\{a: \[1: cannot be read"),
    ("x=[{a: [1]", r"x=\[\{a: \[1\]: cannot be read as a list or as values by name"),
    ("seed=0,1", r"seed=0,1: several values, expected one, or -m for a sweep over them"),
    ("evaluation.radii=5,10", r"evaluation\.radii=5,10: several values, .*radii=\[5,10\] for a l"),
    ("seed=range(3)", r"seed=range\(3\): several values, expected one, or -m for a sweep"),
    # Flags
    ("--foo", r"--foo: no such flag, expected KEY=VALUE or one of --multirun, --cfg"),
    ("--config-name=x", r"--config-name=x: no such flag"),
    ("--cfg=foo", r"--cfg: 'foo', expected one of job, hydra, all"),
    ("--config-dir=/nope", r"--config-dir: /nope, expected a folder of configs"),
]


@pytest.mark.parametrize(("override", "said"), OVERRIDES)
def test_a_mistake_in_the_config_is_one_line_in_our_words(override, said, tmp_path):
    done = deepring("train", "data=sim_nclt", override, cwd=tmp_path)
    assert done.returncode == 2
    assert re.fullmatch(rf"error: {said}.*\n", done.stderr), done.stderr
    assert not re.search("Error|Exception|omegaconf|hydra\\.cc|object_type", done.stderr)


PATHS = (
    *("a/epoch=1.ckpt", "a [1].ckpt", "a,b.ckpt", "a'b.ckpt", 'a"b.ckpt', "{x}.ckpt", "(x).ckpt"),
    *("[1].ckpt", "ä.ckpt", "a#b.ckpt", "a;b&c.ckpt", "a!b.ckpt", "~x.ckpt", 'a\\"=b.ckpt'),
    *("a=\\.ckpt", "\t=x.ckpt", "=.ckpt", "'=.ckpt", "a=b\\"),
)


@pytest.mark.parametrize("path", PATHS)
def test_a_path_that_needs_quotes_is_shown_with_them(path):
    with pytest.raises(ConfigError) as refusal:
        checked(["data=sim_nclt", f"checkpoint={path}"])
    said = str(refusal.value)
    assert said.startswith(f"checkpoint={printable(path)}: ")
    quotes = shlex.quote(quoted("checkpoint", path))
    assert printable(quotes) in said
    given = shlex.split(quotes)
    assert value_of(checked(given), "checkpoint") == path


def test_the_quotes_that_a_mistake_shows_are_right(tmp_path):
    first = deepring("evaluate", "data=sim_nclt", "checkpoint=a [1]/epoch=1.ckpt", cwd=tmp_path)
    (given,) = shlex.split(first.stderr.rpartition(": ")[2])
    again = deepring("evaluate", "data=sim_nclt", given, cwd=tmp_path)
    refused(again, "a [1]/epoch=1.ckpt", "is no file")


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12))
@settings(max_examples=100, derandomize=True, deadline=None)
def test_quotes_keep_every_text(text):
    assert value_of([quoted("resume", text)], "resume") == text


def test_the_home_folder_is_written_out_since_the_shell_leaves_it(tmp_path):
    done = deepring("evaluate", "checkpoint=~/x.ckpt", cwd=tmp_path)
    assert f'checkpoint="{Path.home()}/x.ckpt"' in done.stderr


def test_flags_and_overrides_come_in_any_order(tmp_path):
    texts = [
        deepring("train", *words, cwd=tmp_path)
        for words in (
            ("--cfg", "job", "seed=3", "data=sim_nclt"),
            ("seed=3", "-c=job", "data=sim_nclt"),
            ("seed=3", "--cfg", "job", "data=sim_nclt"),
        )
    ]
    assert all(done.returncode == 0 for done in texts)
    assert "seed: 3" in texts[0].stdout
    assert len({done.stdout for done in texts}) == 1


def test_own_configs_with_mistakes_are_told_as_the_packaged_ones(tmp_path):
    folder = tmp_path / "own" / "experiment"
    folder.mkdir(parents=True)
    files = {
        "broken": (b"a: [", r"broken\.yaml, line 1: is no YAML"),
        "key": (b"# @package _global_\nseeed: 3\n", r"seeed: no such key"),
        "value": (b"# @package _global_\nseed: x\n", r"seed: x, expected a whole number"),
        "binary": (b"\xff\xfe", r"one of its files is no text"),
    }
    for name, (content, said) in files.items():
        (folder / f"{name}.yaml").write_bytes(content)
        words = ("--config-dir", tmp_path / "own", f"experiment={name}")
        done = deepring("train", *words, cwd=tmp_path)
        assert re.fullmatch(rf"error: .*{said}.*\n", done.stderr), done.stderr
