"""The demo's claim, as docs/demo.md prints it."""

import pytest

from deepring.cli.process import tune_process
from deepring.experiment.train import train
from deepring.simulation.presets import nclt
from deepring.simulation.simulate import simulate


@pytest.mark.slow
def test_deepring_leads_ring_and_ring_leads_scan_context(composed, tmp_path):
    tune_process()
    root = simulate(nclt(seed=0), tmp_path / "nclt", workers=2)
    trained = train(composed("experiment=demo", f"data.root={root}"), tmp_path / "run")
    recall = {row.case.method: row.recall_1 for row in trained.results if row.radius_m == 10}
    print(recall)
    assert recall["DeepRING"] >= recall["RING"] + 0.10
    assert recall["RING"] >= recall["Scan Context 20x60"] + 0.10
    assert recall["RING"] >= recall["Scan Context 120x120"] + 0.10
    assert 0.60 <= recall["RING"] <= 0.75
