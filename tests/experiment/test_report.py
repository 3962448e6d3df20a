"""A run as one page: whole in itself, and true to the run's files."""

import html
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from deepring.errors import DeepringError
from deepring.evaluation.matches import matches_in
from deepring.evaluation.recall_curves import read_recall_curves
from deepring.evaluation.results import read_results, write_results
from deepring.experiment.report import report
from deepring.experiment.train import train
from helpers.html_pages import table_rows, well_formed
from helpers.marking import TARGET, Mark


@pytest.fixture(scope="module")
def run(compose_in, tiny_nclt, tmp_path_factory):
    outputs = tmp_path_factory.mktemp("reported")
    cfg = compose_in(
        outputs,
        *("experiment=demo", f"data.root={tiny_nclt}", "data.spacing.train=1"),
        *("sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=1", "trainer.max_epochs=1"),
        *("trainer.log_every_n_steps=1", "callbacks.progress=null"),
        *("data.regions.validation_share=0.3", "data.regions.margin=1", "evaluation.rerank=[]"),
        *("methods.scan_context=null", "methods.scan_context_120=null"),
    )
    train(cfg, outputs / "run")
    return outputs / "run"


@pytest.fixture(scope="module")
def page(run):
    return report(run, pictures=6)


def test_the_page_needs_nothing_beside_it(page):
    assert page.startswith("<!doctype html>")
    assert "<script" not in page
    assert set(re.findall(r'src="([^,]*),', page)) == {"data:image/png;base64"}
    addresses = re.findall(r'(?:href|src)="([^",]*)', page)
    assert {address[:1] for address in addresses} <= {"#", "d"}
    assert not re.findall(r"https?:|@import|url\(", page)
    for heading in ("Methods side by side, right within 10 m", "Queries one by one", "Config"):
        assert heading in page
    assert len(page) < 5e6
    well_formed(page)


def test_every_result_is_on_the_page_as_its_file_has_it(page, run):
    for result in (r for r in read_results(run / "results.csv") if r.radius_m == 10):
        low, high = result.interval("recall_1")
        shown = f"{result.recall_1:.3f} ({low:.2f}-{high:.2f})".replace("(0.", "(.")
        shown = shown.replace("-0.", "-.")
        rows = [row for row in table_rows(page) if row[0] == result.case.method]
        assert shown in [row[2] for row in rows if len(row) == 3]  # beside its bar
        assert [shown, f"{result.f1_max:.3f}", f"{result.auc:.3f}", f"{result.ap:.3f}"] in [
            [row[3], *row[6:9]] for row in rows if len(row) == 11
        ]


def dots_of_recall(page):
    """Title, such as 'RING, R@5: 0.900', without the interval."""
    return {told.partition(" (")[0] for told in re.findall(r"<title>([^<]*, R@\d+: [^<]*)", page)}


def test_recall_over_n_is_drawn_as_its_file_has_it(page, run):
    curves = [curve for curve in read_recall_curves(run) if curve.radius_m == 10]
    results = {r.case: r for r in read_results(run / "results.csv") if r.radius_m == 10}
    assert {curve.case for curve in curves} == set(results)
    for curve in curves:
        assert curve.recalls[0] == results[curve.case].recall_1
        assert curve.recalls[4:5] in ((results[curve.case].recall_5,), ())
    assert dots_of_recall(page) == {
        f"{html.escape(curve.case.method)}, R@{n}: {curve.recalls[n - 1]:.3f}"
        for curve in curves
        for n in (1, 5, 10, 15, 20, 25)
        if n <= len(curve.recalls)
    }
    assert "runs without recalls.csv" not in page


def test_a_run_without_the_file_has_the_recalls_that_it_holds(run, tmp_path):
    shutil.copytree(run, tmp_path / "run", ignore=shutil.ignore_patterns("recalls.csv"))
    page = report(tmp_path / "run", pictures=0)
    assert dots_of_recall(page) == {
        f"{html.escape(r.case.method)}, R@{n}: {recall:.3f}"
        for r in read_results(run / "results.csv")
        if r.radius_m == 10
        for n, recall in ((1, r.recall_1), (5, r.recall_5))
    }
    assert "Of runs without recalls.csv only N of 1 and 5 is known" in page


def test_a_mark_leads_to_the_query_that_it_stands_for(page, run):
    matches = next(m for m in matches_in(run) if m.case.method == "DeepRING")
    links = re.findall(r'<a href="#(query-[^"]*-(\d+))"><title>query (\d+): (\w+)', page)
    assert len(links) == 6
    for name, number, titled, kind in links:
        assert number == titled
        row = int(np.flatnonzero(matches.query == int(number))[0])
        (panel,) = re.findall(rf'<section class="[^"]*" id="{name}">(.*?)</section>', page, re.S)
        assert f"Place {matches.place[row, 0]} was found" in panel
        assert f"{matches.distance[row, 0]:.1f} m away" in panel
        right = matches.distance[row, 0] <= 10
        answerable = matches.nearest[row] <= 10
        assert kind == ("without" if not answerable else "right" if right else "wrong")
        used = set(re.findall(r'<use href="#([^"]*)"', panel))
        assert used >= {name.replace("query-", "q-"), *used}
        assert all(page.count(f'<image id="{one}"') == 1 for one in used)


def test_the_page_is_the_same_every_time(page, run):
    assert report(run, pictures=6) == page


def test_without_the_scans_the_rest_is_shown(run, tiny_nclt, tmp_path):
    copy = tmp_path / "run"
    copy.mkdir()
    for name in ("results.csv", "checkpoints", "retrievals"):
        (copy / name).symlink_to(run / name)
    config = (run / "config.yaml").read_text().replace(str(tiny_nclt), str(tmp_path / "gone"))
    (copy / "config.yaml").write_text(config)
    text = report(copy)
    assert "Without maps and scans, since these are not available" in text
    assert "Precision and recall" in text
    (copy / "checkpoints").unlink()
    assert "the run holds no checkpoint of DeepRING" in report(copy)
    (copy / "retrievals").unlink()
    assert "The run holds no retrievals of DeepRING" in report(copy)


def test_a_run_of_a_stranger_imports_nothing_and_writes_nothing(run, tmp_path):
    stranger, cache = tmp_path / "run", tmp_path / "elsewhere"
    stranger.mkdir()
    for name in ("results.csv", "checkpoints", "retrievals", "figures"):
        (stranger / name).symlink_to(run / name)
    config = (run / "config.yaml").read_text(encoding="utf-8")
    config = re.sub(r"_target_: .*", f"_target_: {TARGET}", config)
    config = re.sub(r"cache: .*", f"cache: {cache}", config)
    assert config.count(TARGET) > 3
    (stranger / "config.yaml").write_text(config, encoding="utf-8")
    (tmp_path / "mark").mkdir()
    with Mark(tmp_path / "mark").unmarked():
        text = report(stranger, pictures=2)
    assert "descriptor of the query" in text  # the pictures are drawn all the same
    assert not cache.exists()
    assert {path.name for path in stranger.iterdir()} == {
        *("results.csv", "checkpoints", "retrievals", "figures", "config.yaml")
    }


SCRIPT = "<script>alert('1')</script><img src=x onerror=\"alert(1)\">"


def test_names_are_text_in_the_page(run, tmp_path):
    result = read_results(run / "results.csv")[0]
    case = replace(result.case, method=SCRIPT, region="\u0440\u00e9gion & 'quotes'")
    write_results(tmp_path / "results.csv", [replace(result, case=case)])
    config = (run / "config.yaml").read_text(encoding="utf-8")
    config = re.sub("experiment_name: .*", f"experiment_name: {json.dumps(SCRIPT)}", config)
    (tmp_path / "config.yaml").write_text(config + "# \u202e</pre>", encoding="utf-8")
    text = report(tmp_path)
    assert "<script" not in text
    assert "<img" not in text
    assert text.count("</pre>") == 1
    assert text.replace("\n", "").isprintable()
    assert html.escape(SCRIPT) in text


def test_pictures_that_are_none_are_not_embedded(run, tmp_path):
    for name in ("results.csv", "config.yaml"):
        shutil.copy(run / name, tmp_path / name)
    (tmp_path / "secret").write_text("secret", encoding="utf-8")
    picture = tmp_path / "figures" / "hits.png"
    picture.parent.mkdir()
    picture.write_bytes(b"<svg onload=alert(1)>")
    with pytest.raises(DeepringError, match=r"hits\.png: no PNG file"):
        report(tmp_path)
    picture.unlink()
    picture.symlink_to(tmp_path / "secret")
    with pytest.raises(DeepringError, match=r"hits\.png: no PNG file"):
        report(tmp_path)


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(DeepringError, match=rf"{tmp_path}: no run in it"):
        report(tmp_path)
    with pytest.raises(DeepringError, match="none: no such folder"):
        report(tmp_path / "none")


def test_a_radius_without_results_is_refused_and_another_is_shown(run):
    with pytest.raises(DeepringError, match="radius: 7 m, expected one of 5, 10, 15, 20, 25"):
        report(run, radius=7.0)
    text = report(run, 0, radius=5.0, over="all")
    results = read_results(run / "results.csv")
    result = next(r for r in results if r.radius_m == 5)
    share = result.recall_1 * result.answerable / result.queries
    assert f"{round(share * result.queries)} of the {result.queries} queries: " in text
    assert "right within 5 m" in text


def test_a_run_without_results_at_its_first_radius_is_named(run, tmp_path):
    results = [r for r in read_results(run / "results.csv") if r.radius_m != 10]
    write_results(tmp_path / "results.csv", results)
    shutil.copy(run / "config.yaml", tmp_path)
    with pytest.raises(DeepringError, match=rf"{tmp_path}/results\.csv: no result within 10 m"):
        report(tmp_path)


def test_a_config_of_other_types_is_named(run, tmp_path):
    (tmp_path / "results.csv").symlink_to(run / "results.csv")
    config = (run / "config.yaml").read_text(encoding="utf-8")
    for old, new in (("seed: 0", "seed: x"), ("overlap: refuse", "overlap: [refuse]")):
        (tmp_path / "config.yaml").write_text(config.replace(old, new), encoding="utf-8")
        with pytest.raises(DeepringError, match=rf"{tmp_path}/config\.yaml: .*evaluate it again"):
            report(tmp_path)
