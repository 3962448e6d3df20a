"""A disk that is full: one error, and nothing half-written is left behind.

A limit on the size of files stands for the disk. With `make kill`, a disk of 64 kB is filled, too.
"""

import resource
import subprocess
from contextlib import contextmanager

import pytest

from helpers.cli import SMALL, deepring
from kill.outcomes import contents, expect_whole_runs, parts

SCANS = ("--session", "2031-02-04")


@contextmanager
def largest_file(size):
    """Writing beyond ``size`` bytes fails."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def mounted(folder, option):
    """A disk in memory, mounted with an option; skips the test where the user may mount none."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", option, "none", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("this user may not mount a disk")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def expect_one_error(done, *words):
    """One line of error, which the command ends with."""
    assert done.returncode != 0
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1, done.stderr
    for word in words:
        assert word in errors[0]
    return errors[0]


COMMANDS = {
    "simulate": (["simulate", "mulran", "-o", "out", "--workers=1"], "out"),
    "map": (["map", "build", "{data}", *SCANS, "-o", "out/town.map"], "out"),
    "loops": (["loops", "{data}", *SCANS, "-o", "out/loops"], "out"),
    "report": (["report", "run", "-o", "out/page.html"], "out"),
    "export": (["export", "shipped", "-o", "out/net.safetensors"], "out"),
    "onnx": (["export", "shipped", "-o", "out/net.onnx"], "out"),
    "tables": (["tables", "run", "-o", "out"], "out"),
}


#: Those that are quick enough for the default tests.
QUICK = ("simulate", "map", "report", "tables")


@pytest.fixture(scope="module")
def trained(tiny_nclt, tmp_path_factory):
    """A folder with a finished training in `run`."""
    folder = tmp_path_factory.mktemp("trained")
    command = ["train", "experiment=demo", f"data.root={tiny_nclt}", *SMALL, "hydra.run.dir=run"]
    done = deepring(*command, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.kill) for name in COMMANDS],
)
def test_a_file_that_does_not_fit_is_one_error_and_no_file(name, trained, tiny_nclt, tmp_path):
    command, written = COMMANDS[name]
    (tmp_path / "run").symlink_to(trained / "run")
    with largest_file(1 if name == "tables" else 200):  # small tables fit
        done = deepring(*(str(a).format(data=tiny_nclt) for a in command), cwd=tmp_path)
    expect_one_error(done, "out")
    assert contents(tmp_path / written) == {}
    assert not parts(tmp_path)


@pytest.mark.parametrize(
    "size", [2000, *(pytest.param(n, marks=pytest.mark.kill) for n in (1, 20_000))]
)
def test_a_training_that_finds_no_space_is_one_error(size, tiny_nclt, tmp_path):
    command = ["train", "experiment=demo", f"data.root={tiny_nclt}", *SMALL, "hydra.run.dir=run"]
    command.append("evaluation.figures=false")  # they come last
    with largest_file(size):
        done = deepring(*command, cwd=tmp_path)
    expect_one_error(done)
    expect_whole_runs(tmp_path)
    assert not parts(tmp_path)
    again = deepring(*command, cwd=tmp_path)
    assert again.returncode == 0, again.stderr


@pytest.mark.kill
def test_a_full_disk(trained, tiny_nclt, tmp_path):
    with mounted(tmp_path / "small", "size=64k") as small:
        (small / "run").symlink_to(trained / "run")
        (small / "ballast").write_bytes(b"x" * 40_000)
        for command, written in COMMANDS.values():
            done = deepring(*(str(a).format(data=tiny_nclt) for a in command), cwd=small)
            if done.returncode:
                expect_one_error(done, "space")
                # What says that a simulation is incomplete stays, and whole tables do.
                tables = {f"ablation.{ending}" for ending in ("md", "tex", "csv")}
                assert set(contents(small / written)) <= {"simulation.json", *tables}
                assert not parts(small)


@pytest.mark.kill
def test_a_read_only_folder(trained, tiny_nclt, tmp_path):
    with mounted(tmp_path / "out", "ro"):
        (tmp_path / "run").symlink_to(trained / "run")
        for command, _ in COMMANDS.values():
            done = deepring(*(str(a).format(data=tiny_nclt) for a in command), cwd=tmp_path)
            expect_one_error(done, "out")
