"""Comparisons and ablations as one page: the best, with what is known of chance, and the runs."""

import html
import json

import numpy as np
import pytest

from deepring.cli.main import parse
from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches, write_matches
from deepring.evaluation.paired import exact_mcnemar
from deepring.evaluation.results import read_results, write_results
from deepring.experiment.report import report
from deepring.experiment.status import Status, write_status
from helpers.html_pages import table_rows, well_formed
from helpers.results import result_of

QUERIES = 40
NASTY = "</title><script>alert(1)</script>\u202e"


def run_folder(folder, method, right, seed=0, classes="ring.Ring", **config):
    """A finished run whose first ``right`` queries are answered rightly, or those in a list."""
    answered = np.isin(np.arange(QUERIES), range(right) if isinstance(right, int) else right)
    case = Case(method, "", "town", "test")
    rates = (float(answered.mean()), 0.95, 0.8, 0.7)
    results = [result_of(case, r, (20, QUERIES, QUERIES), rates) for r in (10.0, 20.0)]
    node = {"_target_": f"deepring.methods.{classes}", "label": method}
    values = {
        "seed": seed,
        "data": {"name": "town", "root": f"towns/{seed}"},
        "evaluation": {"radii": [10.0, 20.0]},
        "method": node,
    } | config
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(json.dumps(values), encoding="utf-8")
    write_results(folder / "results.csv", results)
    write_status(folder, Status("finished", seconds=90.0))
    number = np.arange(QUERIES)
    matches = TopMatches(
        case,
        number,
        number[:, None] % 20,
        np.linspace(1, 0, QUERIES, dtype=np.float32)[:, None],
        None,
        np.where(answered, 1.0, 50.0).astype(np.float32)[:, None],
        np.ones(QUERIES, dtype=np.float32),
    )
    write_matches(folder, matches)


@pytest.fixture
def sweep(tmp_path):
    folder = tmp_path / "sweep"
    for seed in (0, 1):
        run_folder(folder / f"ring-{seed}", "RING", 36, seed)
        run_folder(folder / f"context-{seed}", "Context", 20 + seed, seed)
        run_folder(folder / f"nasty-{seed}", NASTY.replace("\u202e", ""), [*range(4, 38)], seed)
    (folder / "ring-0" / "report.html").write_text("a page")
    return folder


def test_the_best_is_named_with_what_the_paired_test_says(sweep):
    page = report(sweep)
    well_formed(page)
    assert "RING has the highest Recall@1 in town test" in page
    # 0 to 3 against 36 and 37: the nasty one lacks four, and has two more.
    nasty = html.escape(NASTY.replace("\u202e", ""))
    assert f"RING 0.900 (.77-.96), then {nasty} 0.850 (.71-.93). May be chance" in page
    assert f"4 to 2 of 40, p {exact_mcnemar(4, 2):.2g} (seed 0)" in page
    assert "<script" not in page
    assert len(page) < 5e6


def test_every_pair_is_in_the_matrix_and_sure_differences_are_marked(sweep):
    page = report(sweep)
    rows = [row for row in table_rows(page) if row and row[0].startswith("1 RING")]
    assert rows == [["1 RING", "4:24:2", "16:015:0"]]
    assert '<td class="differs" title="seed 0: 40 queries, p 3.1e-05' in page
    assert page.count('class="differs"') == 2  # both before Context


def test_means_and_intervals_are_those_of_the_results(sweep):
    page = report(sweep)
    rates = [read_results(sweep / f"context-{s}" / "results.csv")[0].recall_1 for s in (0, 1)]
    (row,) = [row for row in table_rows(page) if row[0] == "Context" and len(row) == 3]
    assert row[2].startswith(f"{sum(rates) / 2:.3f} (")
    assert f'title="seed 0: {rates[0]:.3f}, seed 1: {rates[1]:.3f}"' in page
    (full,) = [row for row in table_rows(page) if row[1:2] == ["Context"]]
    assert full[3].startswith(f"{sum(rates) / 2:.3f} ± ")


def test_only_runs_with_a_page_are_linked_from_wherever_the_page_is(sweep, tmp_path):
    assert '<a href="ring-0/report.html">ring-0</a>' in report(sweep)
    page = report(sweep, beside=tmp_path / "elsewhere")
    assert '<a href="../sweep/ring-0/report.html">ring-0</a>' in page
    assert page.count("<a href") == 1
    (sweep / "context-0").rename(sweep / "javascript:alert(1)")
    (sweep / "javascript:alert(1)" / "report.html").write_text("a page")
    assert 'href="javascript%3Aalert%281%29/report.html"' in report(sweep)


def test_methods_without_the_same_seeds_are_not_ranked(sweep):
    (sweep / "nasty-1" / "status.json").unlink()
    page = report(sweep)
    assert "No method is named best: not all have the same seeds." in page
    assert "not all have the same seeds.</li>" in page


def test_an_ablation_has_its_settings(tmp_path):
    for seed in (0, 1):
        for ways, right in ((2, 20), (8, 30)):
            case = {"classes": "deepring.DeepRing", "sampling": {"ways": ways}}
            run_folder(tmp_path / f"{ways}-{seed}", "DeepRING", right, seed, **case)
    page = report(tmp_path)
    well_formed(page)
    assert "<h1>Sweep: " in page
    assert "sampling.ways 8 has the highest Recall@1 in town test, settings" in page
    assert "10 to 0 of 40, p 0.002 (seed 0)" in page


def test_a_radius_and_runs_that_do_not_fit_are_refused_as_for_tables(sweep):
    with pytest.raises(DeepringError, match="radius 7 m: no result of"):
        report(sweep, radius=7.0)
    run_folder(sweep / "other", "Other", 3, evaluation={"radii": [10.0], "over": "all"})
    with pytest.raises(DeepringError, match=r"evaluation\.over"):
        report(sweep)
    assert "mixed, so that rows may not be comparable" in report(sweep, mix=True)


def test_the_command_line_gives_what_the_page_takes():
    args = parse(["report", "sweep", "--radius", "5", "--over", "all", "--mix", "--pictures", "3"])
    assert (args.radius, args.over, args.mix, args.pictures) == (5.0, "all", True, 3)
