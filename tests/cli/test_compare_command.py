"""`deepring compare` as a user types it: trains, evaluates, prints both tables, goes on."""

import pytest

from deepring.cli.compare_command import compare_command
from deepring.cli.main import parse
from deepring.evaluation.reranked_labels import method_label
from deepring.evaluation.results import read_results
from deepring.experiment.sweep_outcomes import SweepOutcomes
from deepring.experiment.sweep_plan import read_plan
from helpers.cli import deepring, refused
from helpers.html_pages import table_rows

TINY = (
    *("sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=2", "trainer.max_epochs=1"),
    *("callbacks.progress=null", "trainer.log_every_n_steps=1"),
)


def pointed(nclt, mulran):
    roots = {"sim_nclt": nclt, "sim_mulran": mulran}
    return [
        f"test_data.{name}.{key}"
        for name, root in roots.items()
        for key in (f"root={root}", "spacing.train=1")
    ]


def test_tables_come_of_one_command_and_a_second_start_trains_nothing(
    tiny_nclt, tiny_mulran, tmp_path
):
    trained = [
        *(f"train_data.sim_nclt.root={tiny_nclt}", "train_data.sim_nclt.spacing.train=1"),
        *("train_data.sim_nclt.regions.validation_share=0.3",),
        *("train_data.sim_nclt.regions.margin=1",),
    ]
    shared = [
        *("--test", "sim_nclt,sim_mulran", "--seeds", "0", "evaluation.figures=false"),
        *pointed(tiny_nclt, tiny_mulran),
    ]
    fixed = deepring(
        *("compare", "--learned=", "--fixed", "ring,scan_context", *shared), cwd=tmp_path
    )
    assert fixed.returncode == 0, fixed.stderr
    assert "2 of 2 jobs finished" in fixed.stdout
    learned = [
        *("compare", "--fixed=", "--learned", "deepring_small", "--train", "sim_nclt", *shared),
        *(*TINY, *trained),
    ]
    done = deepring(*learned, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    # Nobody was trained on the city, so that it is a further test set and no Table II.
    for words in ("Table I)", "Further test sets", "RING", "DeepRING", "Costs"):
        assert words in done.stdout
    sweep = tmp_path / "outputs" / "sweeps" / "compare_demo"
    (job,) = sweep.glob("method-deepring_small*")
    places = {(r.case.test, r.case.region) for r in read_results(job / "results.csv")}
    assert places == {("sim_nclt", "test"), ("sim_mulran", "test"), ("sim_mulran", "whole")}
    planned = {of_plan.folder for of_plan in read_plan(sweep).jobs}
    assert planned == {path.parent.name for path in sweep.glob("*/status.json")}
    written = {path.name for path in (sweep / "tables").iterdir()}
    assert {"table1.md", "further.tex", "comparison.csv", "pr_curves.png"} <= written
    page = sweep / "report.html"
    assert done.stdout.splitlines()[-1].split() == ["report", str(page.relative_to(tmp_path))]
    text = page.read_text(encoding="utf-8")
    assert {"RING", "DeepRING"} <= {row[0] for row in table_rows(text)}
    page.unlink()
    again = deepring(*learned, cwd=tmp_path)
    assert "finished before: skipped" in again.stderr
    assert page.read_text(encoding="utf-8") == text
    page.unlink()
    page.mkdir()  # what stands in the way of the page alone
    tables = {path.name: path.read_bytes() for path in (sweep / "tables").glob("*.csv")}
    without = deepring(*learned, cwd=tmp_path)
    assert without.returncode == 1
    assert "Table I)" in without.stdout
    assert "report.html" not in without.stdout
    assert f"no page      {page.relative_to(tmp_path)}: " in without.stderr
    assert {path.name: path.read_bytes() for path in (sweep / "tables").glob("*.csv")} == tables
    # The kept descriptors give the same figures without scans or network; re-ranking needs scans.
    scored = deepring("score", job, "-o", "again.csv", cwd=tmp_path)
    assert scored.returncode == 0, scored.stderr

    def rates(path):
        return {
            (r.case, r.radius_m): (r.recall_1, r.recall_5, r.f1_max, r.auc)
            for r in read_results(path)
            if method_label(r.case.method) == r.case.method
        }

    assert rates(tmp_path / "again.csv") == rates(job / "results.csv") != {}


def test_every_fixed_method_is_run_but_those_that_need_labels(tiny_custom, tmp_path, monkeypatch):
    sweeps = []
    outcomes = SweepOutcomes([], [])
    monkeypatch.setattr(
        "deepring.cli.compare_command.run_multirun", lambda words: sweeps.append(words) or outcomes
    )
    data = ("--test", "sim_custom", "test_data.sim_custom.root=" + str(tiny_custom / "drive.yaml"))
    done = deepring("compare", "--learned=", "--fixed", "all", *data, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("fixed        ")
    assert "left out 1: ssc (needs labels, missing in sim_custom)" in done.stdout
    (methods,) = [word for word in sweeps[0] if word.startswith("method=")]
    assert {"ring", "m2dp_signs"} <= set(methods.removeprefix("method=").split(","))
    assert "ssc" not in methods


def test_the_jobs_of_both_parts_are_known_from_the_beginning(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "deepring.cli.compare_command.run_multirun", lambda _: SweepOutcomes([], [])
    )
    done = deepring(
        *("compare", "--learned", "deepring_small", "--fixed", "ring,ring_plus_plus"),
        *("--train", "sim_nclt", "--test", "sim_nclt", "--seeds", "0,1"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    plan = read_plan(tmp_path / "outputs" / "sweeps" / "compare_demo")
    assert [(job.part, job.varied["method"]) for job in plan.jobs] == [
        *[(0, "ring")] * 2,
        *[(0, "ring_plus_plus")] * 2,
        *[(1, "deepring_small")] * 2,
    ]


def test_what_cannot_be_compared_is_said(tmp_path):
    refused(deepring("compare", "--learned=", "--fixed", "all,ring", cwd=tmp_path), "all,ring")
    nowhere = deepring("compare", "--fixed", "all", "--learned=", "--test", "nowhere", cwd=tmp_path)
    refused(nowhere, "--test: 'nowhere'")
    refused(deepring("compare", "--learned=", "--fixed=", cwd=tmp_path), "both empty")
    refused(deepring("compare", "--learned=", "--fixed", "rign", cwd=tmp_path), "rign")
    assert not list(tmp_path.rglob("results.csv"))


def test_a_bug_in_the_page_is_no_mistake_and_the_tables_come_first(tmp_path, monkeypatch):
    where = "deepring.cli.compare_command."
    done = []

    def broken(*_):
        raise RuntimeError("a bug")

    outcomes = SweepOutcomes([tmp_path / "job"], [])
    monkeypatch.setattr(where + "run_multirun", lambda _: outcomes)
    monkeypatch.setattr(where + "make_tables", lambda args: done.append(args.paths))
    monkeypatch.setattr(where + "sweep_page", broken)
    with pytest.raises(RuntimeError, match="a bug"):
        compare_command(parse(["compare", "--learned=", "--fixed", "ring"]))
    assert done == [[tmp_path]]
