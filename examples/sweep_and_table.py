"""Run a sweep, and read its table.

Two ways of making a descriptor are trained from two seeds each, for a few seconds: enough to see
how a sweep works, too little to see which is better. Each argument is one of the command
`deepring train -m`; started again, it goes on with what is left.
"""

import csv
from pathlib import Path

from deepring.cli.main import main
from deepring.simulation.presets import preset, with_knobs
from deepring.simulation.simulate import simulate

small = {"block": 45.0, "train_columns": 2, "test_columns": 2, "rows": 2, "azimuths": 128}
street = simulate(with_knobs(preset("custom"), {**small, "scan_spacing": 5.0}), Path("street"))

sweep = ["method/aggregation=dft,gap", "seed=0,1"]  # every combination: four jobs
short = ["trainer.max_epochs=1", "sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=4"]
data = [
    "data=sim_custom",
    f"data.root={street / 'drive.yaml'}",
    "data.spacing.train=1",
    "data.regions.validation_share=0.3",
    "data.regions.margin=1",
]
plain = ["method=deepring_small", "method/similarity=l2", "evaluation.rerank=[]", "methods={}"]
quiet = ["evaluation.figures=false", "callbacks.progress=null", "trainer.log_every_n_steps=1"]
main(["train", "-m", "experiment_name=street", *sweep, *short, *data, *plain, *quiet])
main(["tables", "outputs/sweeps/street_sweep"])

for run in sorted(Path("outputs/sweeps/street_sweep").glob("*/results.csv")):
    with run.open(encoding="utf-8") as file:
        within = {float(row["radius_m"]): float(row["recall_1"]) for row in csv.DictReader(file)}
    print(f"{run.parent.name}: Recall@1 {within[10.0]:.2f} within 10 m")
