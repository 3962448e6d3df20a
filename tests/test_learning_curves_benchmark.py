"""The learning curves of runs: minutes without pauses, the best so far, the rise at the end."""

import importlib
import sys
import time
from pathlib import Path

import pytest
from torch.utils.tensorboard import SummaryWriter

RECALLS = [0.1, 0.5, 0.4, 0.6, 0.7, 0.6, 0.8, 0.8]
MINUTES = [5 / 6, 11 / 6, 17 / 6, *(17 / 6 + k - 1 / 6 for k in range(1, 6))]


@pytest.fixture
def curves(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    yield importlib.import_module("learning_curves")
    sys.modules.pop("learning_curves", None)


@pytest.fixture
def run(tmp_path):
    """A run that was interrupted after three of its eight validations, some minutes each."""
    folder = tmp_path / "sweep" / "method-disco_small"
    for suffix, recalls in (("a", RECALLS[:3]), ("b", RECALLS[3:])):
        writer = SummaryWriter(str(folder / "tensorboard"), filename_suffix=suffix)
        start = time.time()
        for k, recall in enumerate(recalls, start=1):
            writer.add_scalar("val/recall@1", recall, k, walltime=start + 60 * k - 10)
        writer.close()
    (folder / "config.yaml").write_text("method: {_target_: deepring.methods.disco.Disco}\n")
    return folder


def test_minutes_go_on_after_an_interruption_without_the_pause(curves, run):
    curve = curves.curve_of(run)
    assert curve.method == "Disco"
    assert curve.recall.tolist() == pytest.approx(RECALLS)
    assert curve.minutes.tolist() == pytest.approx(MINUTES, abs=0.05)
    assert [curve.at(share) for share in (0.25, 0.5, 1.0)] == pytest.approx([0.5, 0.6, 0.8])
    assert curve.rise == pytest.approx(0.8 - 0.65)


def test_all_runs_below_a_folder_make_one_table_and_one_figure(curves, run, monkeypatch, capsys):
    figure = run.parent / "curves.svg"
    empty = run.parent / "evaluated" / "tensorboard"
    SummaryWriter(str(empty)).close()
    arguments = [str(run.parent), str(run), "--output", str(figure), "--queries", "100"]
    monkeypatch.setattr(sys, "argv", ["learning_curves.py", *arguments])
    curves.main()
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 3  # a head and the one run with validations
    assert rows[2].endswith("| 0.500 | 0.600 | 0.700 | 0.800 | +0.150 ± 0.040 |")
    assert "Disco, sweep/method-disco_small" in figure.read_text()


def test_a_folder_without_validations_is_refused(curves, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["learning_curves.py", str(tmp_path)])
    with pytest.raises(SystemExit, match="no run with validations in"):
        curves.main()
