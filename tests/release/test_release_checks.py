"""The check of a release: what it counts as passed, and that it leaves nothing out."""

import re
from pathlib import Path

import pytest
import yaml
from release.__main__ import arguments, series
from release.distributions import differences
from release.environment import CommandError, Environment, _run
from release.interpreters import find
from release.outcome import NOT_CHECKED, PASSED, Outcome, status, table
from release.requirements import (
    OF_THE_CHECKOUT,
    constrained,
    extras,
    lowest,
    of_users,
    project,
)
from release.series import LOWEST, NEWEST
from release.trials import TRIALS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        ([PASSED, PASSED], 0),
        ([PASSED, "failed: a step", f"{NOT_CHECKED}: no interpreter"], 1),
        ([PASSED, f"{NOT_CHECKED}: no interpreter"], 3),
        ([], 3),
        (["PASSED"], 1),
    ],
)
def test_only_what_was_checked_and_passed_counts(results, expected):
    outcomes = [Outcome("3.11", "newest", "bags", result) for result in results]
    assert status(outcomes) == expected
    assert table(outcomes).count("\n") == 1 + len(results)


def test_each_extra_is_tried():
    assert set(TRIALS) == set(project()["optional-dependencies"])
    assert arguments([]).extras == list(TRIALS)
    assert "bags" in extras()
    assert "dev" not in extras()


def test_the_pythons_are_those_of_the_workflow():
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
    job = workflow["jobs"]["test"]
    assert job["strategy"]["matrix"]["python"] == arguments([]).pythons
    assert [step["run"] for step in job["steps"] if "run" in step] == [".ci/run"]


def test_lower_bounds_become_versions():
    asked = of_users(["bags"])
    found = lowest(asked, {"python_version": "3.14"})
    assert len(found) == len(asked) - 1  # one is for Python before 3.14
    assert all(re.fullmatch(r"[\w.\[\],-]+==[\d.]+", one) for one in found), found
    assert lowest(["optuna<3"]) == ["optuna<3"]


def test_what_users_install_has_a_lower_bound():
    assert all("==" in one for one in lowest(of_users(extras())))


def test_the_highest_of_several_lower_bounds_counts():
    assert lowest(["numpy>=1.26", "Numpy>=2", "numpy<3"]) == ["numpy==2"]
    assert lowest(["a>=1.9", "a>=1.10"]) == ["a==1.10"]  # 1.9 is the later of the two texts
    assert lowest(["las_py[b]>=1", "las.py[c]"]) == ["las_py[b,c]==1"]


def test_the_lowest_of_a_checkout_are_those_of_the_extras_within_it():
    found = of_users(["dev"])
    assert {*of_users(["bags"])} <= {*found}
    assert not [one for one in found if one.startswith(("pytest", "ruff", "deepring"))]
    assert "jaxtyping==0.3.11" in lowest(found)  # the base alone asks for less


def test_each_part_is_tried_with_the_versions_that_it_is_about():
    every = dict(series(arguments([]).parts, arguments([]).extras))
    assert set(every) == {LOWEST, NEWEST}
    for versions in (LOWEST, NEWEST):
        sets = [tuple(group.names) for group in every[versions]]
        assert {(name,) for name in extras()} < set(sets)
        assert tuple(extras()) in sets
    assert [group.title for group in every[LOWEST]][-1] == "the tests of the checkout"
    assert {(name,) for name in OF_THE_CHECKOUT} < {tuple(one.names) for one in every[NEWEST]}
    assert dict(series(["pythons"], extras())) == {NEWEST: []}
    assert not dict(series(["files"], extras()))


def test_what_a_file_of_constraints_pins_is_known(tmp_path):
    file = tmp_path / "c.txt"
    file.write_text("# why\nTorch==2.13.0 # a build\n\n")
    assert constrained(file) == {"torch"}
    assert constrained(None) == set()


def test_interpreters_are_found_on_the_path_and_of_pyenv(tmp_path):
    for version in ("3.12.1", "3.12.10", "3.9.2"):
        file = tmp_path / "versions" / version / "bin" / f"python{version.rpartition('.')[0]}"
        file.parent.mkdir(parents=True)
        file.touch(mode=0o755)
    newest = tmp_path / "versions/3.12.10/bin/python3.12"
    assert find("3.12", path="", pyenv=tmp_path) == newest
    assert find("3.13", path="", pyenv=tmp_path) is None
    other = tmp_path / "versions/3.12.1/bin"
    assert find("3.12", path=str(other), pyenv=tmp_path) == other / "python3.12"


def test_wheels_differ_by_names_and_by_bytes():
    assert not differences({"a": b"1"}, {"a": b"1"})
    assert differences({"a": b"1", "b": b""}, {"a": b"2", "c": b""}) == ["a", "b", "c"]


@pytest.mark.parametrize(
    "script", ["exit 3", "echo 'x.py:1: UserWarning: old' >&2"], ids=["status", "warning"]
)
def test_a_command_that_fails_or_warns_is_an_error(tmp_path, script):
    with pytest.raises(CommandError):
        _run(["/bin/sh", "-c", script], tmp_path)


def test_a_copy_of_an_environment_does_not_change_it(tmp_path):
    plain = Environment(tmp_path / "plain")
    (plain.folder / "bin").mkdir(parents=True)
    (plain.folder / "bin" / "module.py").write_text("1")
    (plain.folder / "bin" / "tool").write_text(f"#!{plain.python}\nimport tool\n")
    (plain.folder / "bin" / "tool").chmod(0o755)
    (plain.work / "town.map").write_text("made")
    copy = Environment(tmp_path / "copy")
    copy.copy(plain)
    (copy.folder / "bin" / "module.py").unlink()  # as pip does before it writes another
    (copy.folder / "bin" / "module.py").write_text("2")
    assert (copy.folder / "bin" / "tool").read_text() == f"#!{copy.python}\nimport tool\n"
    assert (copy.folder / "bin" / "tool").stat().st_mode & 0o111
    assert (plain.folder / "bin" / "tool").read_text() == f"#!{plain.python}\nimport tool\n"
    assert (plain.folder / "bin" / "module.py").read_text() == "1"
    assert (copy.work / "town.map").read_text() == "made"
    copy.delete()
    assert not (tmp_path / "copy").exists()
    assert (plain.work / "town.map").exists()
