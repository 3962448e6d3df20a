"""A run as one page: whole in itself, and true to the run's files."""

import html
import json
import re
import shutil
from dataclasses import replace

import pytest

from deepring.errors import DeepringError
from deepring.evaluation.matches import matches_in
from deepring.evaluation.results import read_results, write_results
from deepring.experiment.report import report
from deepring.experiment.train import train
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


def test_the_page_needs_nothing_beside_it(run):
    text = report(run)
    assert text.startswith("<!doctype html>")
    assert "<script" not in text
    assert set(re.findall(r'src="([^,]*),', text)) == {"data:image/png;base64"}
    assert not re.findall(r"(?:href|url)\s*[=(]", text)
    for heading in ("Results, right within 10 m", "The worst failures", "Config"):
        assert heading in text
    assert text.count("<tr>") == 1 + 2  # DeepRING and RING


def test_failures_are_the_wrong_answers_of_the_highest_scores(run):
    matches = next(m for m in matches_in(run) if m.case.method == "DeepRING")
    answerable = matches.nearest <= 10
    wrong = (matches.distance[:, 0] > 10) & answerable
    text = report(run, failures=3)
    assert f"{wrong.sum()} of {answerable.sum()} answerable queries" in text
    drawn = re.findall(r"<figcaption>Scan (\d+): score ([\d.-]+)", text)
    assert len(drawn) == min(3, wrong.sum())
    ordered = sorted(matches.score[wrong, 0], reverse=True)[: len(drawn)]
    assert [score for _, score in drawn] == [f"{score:.3f}" for score in ordered]
    assert {int(scan) for scan, _ in drawn} <= set(matches.query[wrong].tolist())


def test_without_the_scans_the_rest_is_shown(run, tiny_nclt, tmp_path):
    copy = tmp_path / "run"
    copy.mkdir()
    for name in ("results.csv", "checkpoints"):
        (copy / name).symlink_to(run / name)
    config = (run / "config.yaml").read_text().replace(str(tiny_nclt), str(tmp_path / "gone"))
    (copy / "config.yaml").write_text(config)
    text = report(copy)
    assert "the scans are not available" in text
    (copy / "checkpoints").unlink()
    assert "The run holds no checkpoint" in report(copy)


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
        text = report(stranger)
    assert "<figcaption>Scan" in text  # the failures are drawn all the same
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
    assert "<img" not in re.sub('<img src="data:image/png;base64,[^"]*" alt="[^"<>]*">', "", text)
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
    with pytest.raises(DeepringError, match=r"no results\.csv"):
        report(tmp_path)


def test_a_config_of_other_types_is_named(run, tmp_path):
    (tmp_path / "results.csv").symlink_to(run / "results.csv")
    config = (run / "config.yaml").read_text(encoding="utf-8")
    for old, new in (("seed: 0", "seed: x"), ("overlap: refuse", "overlap: [refuse]")):
        (tmp_path / "config.yaml").write_text(config.replace(old, new), encoding="utf-8")
        with pytest.raises(DeepringError, match=rf"{tmp_path}/config\.yaml: .*evaluate it again"):
            report(tmp_path)
