"""One drive as loop closures are published: from the config to what is written."""

import csv

import pytest

from deepring.evaluation.results import read_results
from deepring.experiment.evaluate import evaluate
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.report import report
from deepring.experiment.run_folder import open_run_folder
from helpers.cli import deepring, refused

METHODS = (
    *("checkpoint=null", "~method@methods.scan_context"),
    *("data.earlier.seconds=null", "data.earlier.metres=30", "evaluation.figures=false"),
)


def test_kitti_as_the_field_s_tables_have_it(tiny_kitti, tmp_path):
    options = ("experiment=kitti_online", f"data.root={tiny_kitti}", *METHODS)
    done = deepring("evaluate", *options, "evaluation.descriptors=true", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "kitti_online whole: right within 3 m, wrong beyond 20 m, recall over" in done.stdout
    (run,) = (tmp_path / "outputs/evaluations/kitti_online").glob("2*")
    rows = read_results(run / "results.csv")
    assert [(r.radius_m, r.wrong_beyond_m) for r in rows] == [
        *((3, 20), (5, 20), (10, 20), (20, 20))
    ]
    assert 0 < rows[0].answerable < rows[0].queries < rows[0].database
    scored = deepring(
        *("score", run, "--radii", "3,5,10,20", "--wrong-beyond", 20, "-o", "again.csv"),
        cwd=tmp_path,
    )
    assert scored.returncode == 0, scored.stderr
    again = read_results(tmp_path / "again.csv")
    assert [(r.recall_1, r.f1_max, r.ap) for r in again] == [
        (r.recall_1, r.f1_max, r.ap) for r in rows
    ]
    with (run / "results.csv").open(newline="") as file:
        first = next(csv.DictReader(file))
    assert float(first["recall_1_low"]) < float(first["recall_1"]) <= float(first["recall_1_high"])
    assert "right within 3 m, wrong beyond 20 m" in report(run)
    tables = deepring("tables", run, "--radius", 3, cwd=tmp_path)
    assert tables.returncode == 0, tables.stderr
    assert "right within 3 m, wrong beyond 20 m" in tables.stdout
    assert "RING" in tables.stdout


def test_a_wrong_distance_below_a_radius_and_lacking_stamps_are_one_line(tiny_kitti, tmp_path):
    options = ("experiment=kitti_online", f"data.root={tiny_kitti}", *METHODS)
    done = deepring("evaluate", *options, "evaluation.wrong_beyond=8", cwd=tmp_path)
    refused(done, "evaluation.wrong_beyond: 8", "at least 20")
    done = deepring("evaluate", *options, "data.earlier.seconds=5", cwd=tmp_path)
    refused(done, "data.earlier.seconds: 5", "no time stamps")
    assert not (tmp_path / "outputs/evaluations/kitti_online/latest").exists()


def test_aligned_and_drawn_it_is_evaluated_like_any_other(tiny_kitti, composed, tmp_path):
    cfg = composed(
        *("data=kitti_online", f"data.root={tiny_kitti}", "data.earlier.seconds=null"),
        *("data.earlier.metres=30", "method=ring", "evaluation.regions=[whole]"),
        *("evaluation.rerank=[pose,locate]", "~method@methods.scan_context_120"),
        *("~method@methods.scan_context", "evaluation.candidates=3"),
        *("data.spacing.database=10", "data.spacing.query=15"),
    )
    plan = plan_evaluation(cfg)
    open_run_folder(plan.record, tmp_path / "run")
    results = evaluate(plan, tmp_path / "run").results
    names = {result.case.method for result in results}
    assert {"RING", "RING + pose re-ranking", "RING + map poses (localisation)"} <= names
    best = max(r.recall_1 for r in results if r.radius_m == 10.0)
    assert best == pytest.approx(1, abs=0.3)
    assert (tmp_path / "run" / "figures" / "pr_curves.png").exists()
