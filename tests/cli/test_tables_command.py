"""`deepring tables` on run folders: what is printed and what is written."""

import csv
import json

import pytest

from deepring.cli.report import mistakes_reported
from deepring.cli.tables import tables_command
from deepring.errors import DeepringError
from deepring.evaluation.results import Result, write_results
from deepring.experiment.status import Status, write_status


def train(folder, recall=0.5, seed=0, kind="dft", ways=24, data="sim", status="finished"):
    config = {
        "seed": seed,
        "data": {"name": data},
        "evaluation": {"radii": [10.0]},
        "representation": {"raster": {"kind": "bev"}},
        "aggregation": {"kind": kind},
        "loss": {"_target_": "losses.OneShotCrossEntropy"},
        "episode": {"ways": ways},
    }
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(json.dumps(config))
    rates = (recall, 0.9, 0.8, 0.7)
    result = Result("DeepRING", data, data, "test", 10.0, 50, 100, 50, *rates, 0.01, 0.002)
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
    tables_command([str(sweep)])
    out = capsys.readouterr().out
    assert ["Ours", "SG", "DFT", "CE", "0.850", "±", "0.071", "0.859"] in shown(out)
    assert "left out: sweep/gmp-0: failed: broke" in out
    assert "GMP" not in out
    written = sweep / "tables"
    files = {path.name for path in written.iterdir()}
    assert files == {"table3.md", "table3.tex", "table3.csv", "table3.png"}
    assert all(f"tables/{name}" in out for name in files)
    assert "| Ours | SG | DFT | CE | **0.850 ± 0.071** | 0.859 |" in (
        written / "table3.md"
    ).read_text(encoding="utf-8")
    assert r"\textbf{0.850 $\pm$ 0.071} & 0.859 \\" in (written / "table3.tex").read_text()
    assert (written / "table3.png").read_bytes().startswith(b"\x89PNG")
    with (written / "table3.csv").open(newline="") as file:
        rows = {row["Aggregation"]: row for row in csv.DictReader(file)}
    assert float(rows["DFT"]["recall_1_mean"]) == pytest.approx(0.85)
    assert rows["GAP"]["seeds"] == "0 1"


def test_the_same_command_again_gives_the_same_files(sweep):
    tables_command([str(sweep)])
    before = {path: path.read_bytes() for path in (sweep / "tables").iterdir()}
    tables_command([str(sweep)])
    assert {path: path.read_bytes() for path in (sweep / "tables").iterdir()} == before


def test_several_sweeps_into_a_chosen_folder(sweep, tmp_path, capsys):
    for ways in (8, 16):
        train(tmp_path / "way" / str(ways), ways=ways)
    out = tmp_path / "here"
    tables_command([str(sweep), str(tmp_path / "way"), "-o", str(out)])
    stems = {path.stem for path in out.iterdir()}
    assert stems == {"table3", "table4"}
    assert not (sweep / "tables").exists()
    assert ["paper", "0.834", "0.855", "0.859"] in shown(capsys.readouterr().out)


def test_other_data_needs_mix(sweep, capsys):
    train(sweep / "other", seed=0, kind="gap", data="real")
    with pytest.raises(DeepringError, match=r"data\.name: 'sim' in .*, 'real' in .*/other"):
        tables_command([str(sweep)])
    assert not (sweep / "tables").exists()
    tables_command([str(sweep), "--mix"])
    assert "data.name" in capsys.readouterr().out


def test_over_all_queries_and_a_radius_that_is_not_there(sweep, capsys):
    tables_command([str(sweep), "--over", "all"])
    assert "0.425 ± 0.035" in capsys.readouterr().out
    with pytest.raises(DeepringError, match=r"radius 5 m: .*--radius"):
        tables_command([str(sweep), "--radius", "5"])


def test_a_mistake_ends_with_status_2(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        mistakes_reported(tables_command)([str(tmp_path / "absent")])
    assert ended.value.code == 2
    assert "absent: no such folder" in capsys.readouterr().err
