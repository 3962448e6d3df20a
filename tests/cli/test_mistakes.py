"""A mistake in the words of the command line: flags for arguments, plain words for errno."""

import errno
import re

import pytest

from deepring.cli.mistakes import is_mistake, report_mistakes, with_flags
from deepring.errors import ConfigError, StoppedError
from helpers.cli import deepring

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


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("method.encoder.wdths=[8]", r"method\.encoder\.wdths: no such key; .* has .*widths"),
        ("representation=polar_gram", r"representation: no such key; the config has .*method"),
        ("paths.roots.kitti2=/x", r"paths\.roots\.kitti2: no such key; paths\.roots has .*kitti"),
        ("data=own", r"data: 'own', expected one of custom, .*nclt"),
        ("method/representation=grm", r"method/representation: 'grm', expected one of polar_gram"),
        ("seed=a", r"seed: a, expected a whole number"),
        ("data.ground_z=up", r"data\.ground_z: up, expected a number"),
        ("evaluation.radii=ten", r"evaluation\.radii: ten, expected a list, as \[1, 2\]"),
        ("seed", r"seed: cannot be read; expected KEY=VALUE"),
        ("x=[{a: [1", r"x=\[\{a: \[1: cannot be read; expected KEY=VALUE"),
        ("seed=0,1", r"seed=0,1: several values; expected seed=\[0,1\] for a list, or -m"),
    ],
)
def test_a_mistake_in_the_config_is_one_line_in_our_words(override, said, tmp_path):
    done = deepring("train", "data=sim_nclt", override, cwd=tmp_path)
    assert done.returncode == 2
    assert re.fullmatch(rf"error: {said}.*\n", done.stderr), done.stderr
