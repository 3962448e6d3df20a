"""`deepring score` on exported descriptors: what is printed, what is written, what is refused."""

import importlib

import pytest

from deepring.evaluation.protocol import evaluate_method
from deepring.evaluation.results import read_results
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.rasters import BevRaster, ContextRaster
from deepring.reports.results_table import interval_text
from helpers.cli import deepring, refused, work_of
from helpers.drives import road_task

pytestmark = pytest.mark.usefixtures("wide")

METHODS = {
    "RING": Ring(BevRaster(cells=24), angles=24, bins=24),
    "Scan Context": ScanContext(ContextRaster(sectors=24, rings=8)),
}
RADII = (5.0, 12.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run's folder, and the rows that its evaluation gave."""
    folder = tmp_path_factory.mktemp("run")
    rows = []
    for label, method in METHODS.items():
        task = road_task(method.raster)
        evaluate_method(task.case(label), method, task, export=folder / "descriptors")
        rows += evaluate_method(task.case(label), method, task, RADII).results
    return folder, rows


def without_seconds(rows):
    return [{k: v for k, v in vars(r).items() if not k.startswith("seconds")} for r in rows]


def shown(out):
    return [line.split() for line in out.splitlines()]


def test_the_figures_are_those_of_an_evaluation_at_these_radii(run, tmp_path, capsys):
    folder, rows = run
    path = tmp_path / "new" / "results.csv"
    work_of("score", folder, "--radii", "5,12", "-o", path)
    out = capsys.readouterr().out
    assert "right within 5 m, recall over answerable queries" in out
    assert "Recall@1 over answerable queries" in out
    assert f"results      {path}" in out
    written = read_results(path)
    assert without_seconds(written) == without_seconds(rows)
    assert all(row.seconds_per_scan > 0 < row.seconds_per_query for row in written)
    ring = next(line for line in shown(out) if line[:1] == ["RING"])
    best = rows[0]
    assert ring[1:7] == ["-", f"{best.answerable}/70", *rates(best)]


def rates(row):
    return [
        text
        for recall in (row.recall_1, row.recall_5)
        for text in (f"{recall:.3f}", interval_text(recall, row.answerable))
    ]


def test_by_default_nothing_is_written_and_the_protocol_s_radii_are_shown(run, capsys):
    folder, _ = run
    before = sorted(folder.rglob("*"))
    work_of("score", folder / "descriptors")
    out = capsys.readouterr().out
    assert "right within 10 m" in out
    assert header(out)[-10:] == ["5", "m", "10", "m", "15", "m", "20", "m", "25", "m"]
    assert sorted(folder.rglob("*")) == before


def header(out):
    return next(line for line in shown(out) if "25" in line)


def test_one_radius_over_all_queries_is_one_table(run, capsys):
    folder, _ = run
    work_of("score", folder, "--radii", "5", "--over", "all")
    out = capsys.readouterr().out
    assert "recall over all queries" in out
    assert "Recall@1 over" not in out


def test_an_existing_file_is_not_overwritten(run, tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("precious")
    refused(deepring("score", run[0], "-o", path, cwd=tmp_path), "results.csv exists", "--output")
    assert path.read_text() == "precious"


@pytest.mark.parametrize("radii", ["", "ten", "10,", "10,10", "0", "-5", "nan", "inf"])
def test_radii_that_are_none_are_refused(run, radii, tmp_path):
    done = deepring("score", run[0], f"--radii={radii}", cwd=tmp_path)
    refused(done, f"--radii: {radii!r}, expected different lengths in metres")


def test_an_altered_byte_is_refused(run, tmp_path):
    for path in (run[0] / "descriptors").iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    broken = tmp_path / "RING__road__test__database.safetensors"
    broken.write_bytes(broken.read_bytes()[:-1] + b"\x7f")
    done = deepring("score", tmp_path, "-o", "results.csv", cwd=tmp_path)
    refused(done, f"error: descriptors {broken}: ")
    assert done.returncode == 2
    assert not done.stdout
    assert not (tmp_path / "results.csv").exists()


def test_mistakes_are_named(run, tmp_path):
    refused(deepring("score", tmp_path / "absent", cwd=tmp_path), "absent: no such folder")
    done = deepring("score", run[0], "--over", "most", cwd=tmp_path)
    refused(done, "--over: 'most', expected one of answerable, all")


def test_a_method_of_ones_own_is_named_by_its_class(tmp_path, monkeypatch):
    code = "from deepring.methods.ring import Ring\n\n\nclass Mine(Ring):\n    pass\n"
    (tmp_path / "my_rings.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    method = importlib.import_module("my_rings").Mine(BevRaster(cells=24), angles=24, bins=24)
    task = road_task(method.raster)
    evaluate_method(task.case("Mine"), method, task, export=tmp_path / "descriptors")
    done = deepring("score", tmp_path, cwd=tmp_path)
    refused(done, "my_rings.Mine", "not registered", "as --method")
    done = deepring("score", tmp_path, "--method", "my_rings.Mine", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Mine" in done.stdout
