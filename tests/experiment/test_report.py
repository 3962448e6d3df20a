"""A run as one page: whole in itself, and true to the run's files."""

import re

import pytest

from deepring.errors import DeepringError
from deepring.evaluation.matches import matches_in
from deepring.experiment.report import report
from deepring.experiment.train import train


@pytest.fixture(scope="module")
def run(compose_in, tiny_nclt, tmp_path_factory):
    outputs = tmp_path_factory.mktemp("reported")
    cfg = compose_in(
        outputs,
        *("experiment=demo", f"data.root={tiny_nclt}", "data.spacing.train=1"),
        *("sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=1", "trainer.max_epochs=1"),
        *("trainer.log_every_n_steps=1", "callbacks.progress=null"),
        *("data.regions.validation_share=0.3", "data.regions.margin=1"),
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
