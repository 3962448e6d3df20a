"""`deepring properties`, called as the command line calls it."""

import csv

import pytest

from deepring.methods.network_file import TrainedNetwork, write_network
from helpers.cli import deepring, refused
from helpers.networks import small_network

WRITTEN = {
    *("properties.csv", "properties_borne.md", "properties_borne.tex"),
    *("properties_told.md", "properties_told.tex"),
    *("properties_cost.md", "properties_cost.tex"),
}


def test_two_methods_and_a_network_on_the_scans_of_a_dataset(tiny_nclt, tmp_path):
    network = small_network()
    write_network(tmp_path / "own.safetensors", TrainedNetwork(network, "campus", "Loss"))
    done = deepring(
        *("properties", tiny_nclt, "--methods", "fast_histogram,polar_context", "--scans", 40),
        *("--checkpoint", "own.safetensors", "-o", "out"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "seed 0" in done.stdout
    assert "exact" in done.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} == WRITTEN
    with (tmp_path / "out" / "properties.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["Fast Histogram", "Scan Context++ PC", "DeepRING"]
    assert rows["Fast Histogram"]["numbers"] == "100"
    assert float(rows["Scan Context++ PC"]["loss_sectors"]) < 1e-4
    assert int(rows["DeepRING"]["parameters"]) == sum(p.numel() for p in network.parameters())
    table = (tmp_path / "out" / "properties_told.md").read_text(encoding="utf-8")
    assert table.startswith("What methods tell: nclt, ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--methods", "nothing"], ["--methods: 'nothing'", "fast_histogram"]),
        (["--methods", "ssc"], ["--methods: ssc needs points with labels"]),
        (["--methods", "fast_histogram", "--scans", "2"], ["all of one place"]),
        (["--methods", "fast_histogram", "--scans", "1"], ["--scans: 1"]),
        (["--checkpoint", "no.ckpt"], ["no.ckpt"]),
    ],
)
def test_mistakes_are_named_and_write_nothing(arguments, words, tiny_nclt, tmp_path):
    refused(deepring("properties", tiny_nclt, *arguments, "-o", "out", cwd=tmp_path), *words)
    assert not list(tmp_path.iterdir())
