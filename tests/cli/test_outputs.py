"""Where a command writes: what cannot be written is noticed before the work, and leaves nothing."""

import resource
from contextlib import contextmanager
from pathlib import Path

import pytest

from deepring.cli.options import expect_folder, expect_new
from deepring.errors import FileError
from helpers.cli import deepring, refused

#: Every command that writes where -o says, with inputs that are missing or that take long.
WRITERS = (
    ("map", "build", "drive"),
    ("map", "calibrate", "a.map", "drive"),
    ("loops", "drive"),
    ("export", "shipped"),
    ("simulate", "nclt"),
    ("case-study", "drive"),
    ("properties", "drive"),
    ("tables", "run"),
    ("report", "run"),
    ("score", "run"),
)


@pytest.mark.parametrize("command", WRITERS)
def test_an_output_below_a_file_is_refused_before_any_work(command, tmp_path):
    (tmp_path / "file").write_bytes(b"kept")
    done = refused(deepring(*command, "-o", "file/below/x", cwd=tmp_path), "--output: file/below/x")
    assert f"{tmp_path}/file is a file" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_bytes() == b"kept"


@pytest.mark.parametrize("command", ["train", "evaluate"])
def test_a_run_s_folder_is_refused_before_any_work(command, tmp_path):
    (tmp_path / "file").touch()
    done = deepring(command, "data=sim_nclt", "paths.outputs=file", cwd=tmp_path)
    refused(done, "file/", "lies below a file")
    sweep = deepring("train", "-m", "seed=0,1", "paths.outputs=file", cwd=tmp_path)
    refused(sweep, "file/sweeps", "lies below a file")
    assert "Warning" not in sweep.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs Linux's /proc")
def test_a_folder_in_which_nothing_can_be_made_is_refused():
    for check in (expect_new, expect_folder):
        with pytest.raises(FileError, match=r"^output: /proc/a/b .* no file can be made in /proc"):
            check(Path("/proc/a/b"))


def test_a_name_that_is_too_long_or_no_utf_8_is_refused(tmp_path):
    with pytest.raises(FileError, match="its name is too long"):
        expect_new(tmp_path / ("n" * 252))  # beside it there is a file of a longer name
    with pytest.raises(FileError, match="expected a name in UTF-8"):
        expect_new(tmp_path / "a\udcff.map")


def test_what_can_be_written_leaves_no_trace(tmp_path):
    expect_new(tmp_path / "new" / "folders" / "a.map")
    expect_folder(tmp_path / "new")
    expect_folder(tmp_path)
    assert not list(tmp_path.iterdir())
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(FileError, match="link exists"):
        expect_new(tmp_path / "link")


@contextmanager
def largest_file(size):
    """As on a full disk: no file may become larger."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_one_error_and_leaves_nothing(tmp_path):
    with largest_file(1024):
        done = deepring("export", "shipped", "-o", "a.safetensors", cwd=tmp_path)
    refused(done, "a.safetensors: cannot be written")
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
