"""Names from files and of files, as commands print them: text on one line, whatever is in it."""

import csv
import io
import json

import numpy as np
import pytest

from deepring.evaluation.case import Case
from deepring.evaluation.results import write_results
from deepring.localization.map import Map
from deepring.testing import walls
from helpers.cli import deepring
from helpers.networks import small_network
from helpers.results import result_of

NAMES = {
    "escape": "a\x1b[2J\x1b]0;title\x07.bin",
    "line": "a\nerror: all is well\n.bin",
    "return": "a\rb.bin",
    "c1": "a\x9b31m.bin",
    "direction": "a\u202enib.exe",
    "markup": "[red]a[/red][link=http://x]b[/link].bin",
    "emoji": ":warning: a.bin",
    "formula": "=cmd|' /C calc'!A0",
}


def is_plain(text):
    """Lines of characters that print."""
    return text.replace("\n", "").isprintable()


@pytest.fixture(scope="module", params=NAMES)
def name(request):
    return NAMES[request.param]


@pytest.fixture(scope="module")
def named(name, tmp_path_factory):
    """A folder with a map whose places have the name, and a scan."""
    folder = tmp_path_factory.mktemp("named")
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 50.0
    place_map = Map(small_network())
    place_map.add([walls(0), walls(1)], poses, [name, name])
    place_map.save(folder / "a.map")
    np.save(folder / "scan.npy", walls(0))
    return folder


def test_names_of_places_are_printed_as_text(name, named):
    shown = name if name.isprintable() else name.encode("unicode_escape").decode()
    done = deepring("localize", "a.map", "scan.npy", cwd=named)
    assert done.returncode == 0
    assert is_plain(done.stdout + done.stderr)
    assert len(done.stdout.splitlines()) == 2
    assert shown.removesuffix(".bin") in done.stdout  # the one ending of all names is left out
    done = deepring("localize", "a.map", "scan.npy", "--as", "csv", cwd=named)
    assert is_plain(done.stdout)
    (row,) = csv.DictReader(io.StringIO(done.stdout))
    assert row["name"] == shown
    done = deepring("localize", "a.map", "scan.npy", "--as", "jsonl", cwd=named)
    assert is_plain(done.stdout)
    assert json.loads(done.stdout)["name"] == name


def test_names_of_files_are_printed_as_text(name, named, tmp_path):
    file = name.replace("/", "_")
    (tmp_path / f"{file}.map").write_bytes((named / "a.map").read_bytes())
    (tmp_path / f"{file}.npy").write_bytes((named / "scan.npy").read_bytes())
    (tmp_path / f"{file}.pcd").write_bytes(b"no scan")
    done = deepring("localize", f"{file}.map", f"{file}.npy", f"{file}.pcd", cwd=tmp_path)
    assert done.returncode == 1
    assert is_plain(done.stdout + done.stderr)
    assert len(done.stderr.splitlines()) == 1
    done = deepring("map", "info", f"{file}.map", cwd=tmp_path)
    assert done.returncode == 0
    assert is_plain(done.stdout)
    assert done.stdout.splitlines()[0].startswith("map ")
    assert done.stdout.splitlines()[1].startswith("places ")
    for arguments in (("map", "info", f"{file}.none"), ("report", file), ("tables", file)):
        done = deepring(*arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert is_plain(done.stderr)
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("label", ["[red]x[/red]", ":warning:", "<b>x</b>", "$x^{", "a|b", "=1+1"])
def test_labels_of_results_are_printed_as_text(label, tmp_path):
    """A run's results in the tables of the terminal, of Markdown, of LaTeX, and in figures."""
    run = tmp_path / "run"
    case = Case(label, "", "sim", "test")
    write_results(run / "results.csv", [result_of(case, 10.0)])
    (run / "status.json").write_text('{"state": "finished"}', encoding="utf-8")
    (run / "versions.json").write_text('{"git_commit": "\\u001b[2J"}', encoding="utf-8")
    config = {"seed": 0, "data": {"name": "sim"}, "method": {"_target_": "a.b"}, "train_data": {}}
    (run / "config.yaml").write_text(json.dumps(config), encoding="utf-8")
    done = deepring("tables", run, "-o", tmp_path / "out", cwd=tmp_path)
    assert done.returncode == 0
    assert is_plain(done.stdout + done.stderr)
    assert label in done.stdout
    written = list((tmp_path / "out").glob("*.md"))
    assert written
    for path in written:
        assert "<" not in path.read_text(encoding="utf-8").replace(r"\<", "")
