"""`deepring tables` on run folders: what is printed and what is written."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches, read_matches, write_matches
from deepring.evaluation.results import write_results
from deepring.experiment.status import Status, write_status
from helpers.cli import deepring, refused, work_of
from helpers.results import result_of

pytestmark = pytest.mark.usefixtures("wide")


def train(folder, recall=0.5, seed=0, kind="dft", ways=24, data="sim", status="finished"):
    config = {
        "seed": seed,
        "data": {"name": data},
        "evaluation": {"radii": [10.0]},
        "method": {
            "_target_": "deepring.methods.deepring.DeepRing",
            "raster": {"kind": "bev"},
            "representation": {"theta_range": "full"},
            "aggregation": {"kind": kind},
            "similarity": {"kind": "correlation"},
        },
        "loss": {"_target_": "losses.OneShotCrossEntropy"},
        "sampling": {"ways": ways},
    }
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(json.dumps(config))
    rates = (recall, 0.9, 0.8, 0.7)
    result = result_of(Case("DeepRING", data, data, "test"), 10.0, rates=rates)
    write_results(folder / "results.csv", [result])
    write_status(folder, Status(status, error="broke" if status == "failed" else None))


@pytest.fixture
def sweep(tmp_path):
    folder = tmp_path / "sweep"
    for seed in (0, 1):
        train(folder / f"ours-{seed}", 0.8 + seed / 10, seed)
        train(folder / f"gap-{seed}", 0.6, seed, kind="gap")
    train(folder / "gmp-0", kind="gmp", status="failed")
    return folder


def shown(out):
    return [line.split() for line in out.splitlines()]


def test_the_table_is_printed_and_written_in_every_format(sweep, capsys):
    work_of("tables", sweep)
    out = capsys.readouterr().out
    assert ["Ours", "SG", "DFT", "CE", "0.850", "±", "0.071", "(.73-.92)", "0.859"] in shown(out)
    assert "left out: sweep/gmp-0: failed: broke" in out
    assert "GMP" not in out
    written = sweep / "tables"
    files = {path.name for path in written.iterdir()}
    assert files == {"table3.md", "table3.tex", "table3.csv", "table3.png"}
    assert all(f"tables/{name}" in out for name in files)
    assert "| Ours | SG | DFT | CE | **0.850 ± 0.071 (.73-.92)** | 0.859 |" in (
        written / "table3.md"
    ).read_text(encoding="utf-8")
    assert (
        r"\textbf{0.850 $\pm$ 0.071 (.73-.92)} & 0.859 \\" in (written / "table3.tex").read_text()
    )
    assert (written / "table3.png").read_bytes().startswith(b"\x89PNG")
    with (written / "table3.csv").open(newline="") as file:
        rows = {row["Aggregation"]: row for row in csv.DictReader(file)}
    assert float(rows["DFT"]["recall_1_mean"]) == pytest.approx(0.85)
    assert rows["GAP"]["seeds"] == "0 1"


def test_the_same_command_again_gives_the_same_files(sweep):
    work_of("tables", sweep)
    before = {path: path.read_bytes() for path in (sweep / "tables").iterdir()}
    work_of("tables", sweep)
    assert {path: path.read_bytes() for path in (sweep / "tables").iterdir()} == before


def test_several_sweeps_into_a_chosen_folder(sweep, tmp_path, capsys):
    for ways in (8, 16):
        train(tmp_path / "way" / str(ways), ways=ways)
    out = tmp_path / "here"
    work_of("tables", sweep, tmp_path / "way", "-o", out)
    stems = {path.stem for path in out.iterdir()}
    assert stems == {"table3", "table4"}
    assert not (sweep / "tables").exists()
    assert ["paper", "0.834", "0.855", "0.859"] in shown(capsys.readouterr().out)


def test_other_data_needs_mix(sweep, capsys):
    train(sweep / "other", seed=0, kind="gap", data="real")
    with pytest.raises(DeepringError, match=r"data\.name: 'sim' in .*, 'real' in .*/other"):
        work_of("tables", sweep)
    assert not (sweep / "tables").exists()
    work_of("tables", sweep, "--mix")
    assert "data.name" in capsys.readouterr().out


def test_over_all_queries_and_a_radius_that_is_not_there(sweep, capsys):
    work_of("tables", sweep, "--over", "all")
    assert "0.425 ± 0.035" in capsys.readouterr().out
    with pytest.raises(DeepringError, match=r"radius 5 m: .*`radius`"):
        work_of("tables", sweep, "--radius", "5")


def test_a_mistake_ends_with_status_2_and_names_the_flag(sweep, tmp_path):
    done = refused(deepring("tables", sweep, "--radius", 5, cwd=tmp_path), "with --radius, or")
    assert done.returncode == 2
    done = refused(deepring("tables", "absent", cwd=tmp_path), "absent: no such folder")
    assert done.returncode == 2


def compared(folder, method, kind, trained, seed=0, recall=0.5, retrievals=True):
    """A run folder of a method that was tested in two regions of both datasets."""
    data = {"name": trained or "sim_nclt", "format": "nclt", "root": f"worlds/{seed}"}
    config = {
        "seed": seed,
        "data": data,
        "evaluation": {"radii": [10.0]},
        "method": {
            "_target_": f"deepring.methods.{kind}",
            "label": method,
            "note": f"own {method}",
        },
    }
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(json.dumps(config))
    results = []
    for number, test in enumerate(("sim_nclt", "sim_mulran")):
        for region in ("test", "whole"):
            rates = (recall + number / 10, 0.9, 0.8, 0.7)
            case = Case(method, trained, test, region)
            results.append(result_of(case, 10.0, rates=rates))
            if retrievals:
                metres = np.arange(100, dtype=np.float32)[:, None] % 17
                place, nearest = np.zeros((100, 1), np.int64), metres[:, 0] / 2
                matches = (np.arange(100), place, -metres, None, metres, nearest)
                write_matches(folder, TopMatches(case, *matches))
    write_results(folder / "results.csv", results)
    write_status(folder, Status("finished", seconds=90.0 if trained else None))


@pytest.fixture
def comparison(tmp_path):
    folder = tmp_path / "comparison"
    for seed in (0, 1):
        for train in ("sim_nclt", "sim_mulran"):
            name = f"disco-{train}-{seed}"
            compared(folder / name, "DiSCO", "disco.Disco", train, seed, 0.6 + seed / 10)
        compared(folder / f"ring-{seed}", "RING", "ring.Ring", "", seed)
    return folder


def test_runs_of_several_methods_are_compared(comparison, capsys):
    work_of("tables", comparison)
    out = capsys.readouterr().out
    assert ["sim_nclt", "RING", "0.500", "±", "0.000", "(.37-.63)"] in [
        row[:6] for row in shown(out)
    ]
    assert ["DiSCO", "0.650", "±", "0.071", "(.51-.77)"] in [row[:5] for row in shown(out)]
    assert "DiSCO: own DiSCO" in out
    written = comparison / "tables"
    files = {path.name for path in written.iterdir()}
    names = ("table1", "table2", "crossing", "costs", "paired")
    expected = {f"{name}.{ending}" for name in names for ending in ("md", "tex")}
    assert files == expected | {"comparison.csv", "paired.csv", "pr_curves.png"}
    assert all(f"tables/{name}" in out for name in files)
    assert "**0.650 ± 0.071 (.51-.77)** | 0.793" in (written / "table1.md").read_text(
        encoding="utf-8"
    )
    assert r"\textbf{0.650 $\pm$ 0.071 (.51-.77)} & 0.793" in (written / "table1.tex").read_text()
    assert "| DiSCO | 10 | 2 | 1.5 | 2 |" in (written / "costs.md").read_text()
    assert (written / "pr_curves.png").read_bytes().startswith(b"\x89PNG")
    with (written / "comparison.csv").open(newline="") as file:
        rows = {
            (row["method"], row["train"], row["test"], row["region"]): row
            for row in csv.DictReader(file)
        }
    assert len(rows) == 12
    row = rows["DiSCO", "sim_nclt", "sim_mulran", "whole"]
    assert (row["table"], row["recall_1_seed_0"], row["paper_auc"]) == ("table2", "0.7", "0.796")
    assert "no curve" not in out
    with (written / "paired.csv").open(newline="") as file:
        pairs = list(csv.DictReader(file))
    assert {(pair["one"], pair["other"]) for pair in pairs} == {("DiSCO", "RING")}
    assert {pair["p"] for pair in pairs} == {"1.0"}, "all retrieved the same"
    assert len(pairs) == 8


def test_two_methods_are_told_apart_by_the_queries_that_one_alone_answers(tmp_path, capsys):
    sweep = tmp_path / "sweep"
    compared(sweep / "disco", "DiSCO", "disco.Disco", "sim_nclt", recall=0.7)
    compared(sweep / "ring", "RING", "ring.Ring", "")
    path = sweep / "ring" / "retrievals" / "RING__sim_nclt__test.csv"
    matches = read_matches(path)
    distance = matches.distance.copy()
    distance[:8] = 50.0  # right without that: 0 to 7 m
    distance[16] = 1.0  # wrong without that: 16 m
    write_matches(sweep / "ring", replace(matches, distance=distance))
    work_of("tables", sweep)
    ends = [row[-5:] for row in shown(capsys.readouterr().out)]
    assert ["RING", "100", "8", "1", "0.039"] in ends


def test_compared_again_gives_the_same_files_wherever_they_are_written(comparison, tmp_path):
    work_of("tables", comparison)
    before = {path.name: path.read_bytes() for path in (comparison / "tables").iterdir()}
    work_of("tables", comparison, "-o", tmp_path / "here")
    assert {path.name: path.read_bytes() for path in (tmp_path / "here").iterdir()} == before


def test_without_retrievals_there_is_no_figure_and_a_missing_one_is_named(tmp_path, capsys):
    sweep = tmp_path / "sweep"
    compared(sweep / "ring", "RING", "ring.Ring", "", retrievals=False)
    compared(sweep / "disco", "DiSCO", "disco.Disco", "sim_nclt", retrievals=False)
    work_of("tables", sweep)
    assert "no figure" in capsys.readouterr().out
    assert not (sweep / "tables" / "pr_curves.png").exists()
    compared(sweep / "egonn", "EgoNN", "egonn.EgoNnGlobal", "sim_nclt")
    work_of("tables", sweep)
    out = capsys.readouterr().out
    assert "no curve     RING, tested on sim_nclt test, seed 0: no retrievals/*.csv" in out
    assert (sweep / "tables" / "pr_curves.png").exists()


def test_compared_over_all_queries_at_a_radius_and_mixed(comparison, capsys):
    work_of("tables", comparison, "--over", "all")
    assert "0.325 ± 0.035" in capsys.readouterr().out
    with pytest.raises(DeepringError, match=r"radius 5 m: .*`radius`"):
        work_of("tables", comparison, "--radius", "5")
    path = comparison / "ring-0" / "config.yaml"
    config = json.loads(path.read_text())
    path.write_text(json.dumps(config | {"preprocessing": {"window": 7}}))
    message = r"preprocessing\.window: None in .*/disco-.*, 7 in .*/ring-0.*`mix`"
    with pytest.raises(DeepringError, match=message):
        work_of("tables", comparison)
    work_of("tables", comparison, "--mix")
    assert "mixed, so that rows may not be comparable" in capsys.readouterr().out
