"""Every method through every command: it works, or one line says why not and what to do instead."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from deepring.evaluation.protocol import evaluate_method
from deepring.experiment.config_groups import config_folder
from deepring.experiment.entries import method_entries
from deepring.experiment.every_method import every_method
from deepring.methods.method import RelativePoses
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import TrainedNetwork, write_network
from deepring.methods.registry import packaged_methods
from deepring.testing import walls, with_columns
from helpers.cli import deepring
from helpers.drives import road_task
from helpers.tiny_methods import TINY

METHODS = sorted(packaged_methods())
LEARNED = [name for name in METHODS if isinstance(TINY[name](), NetworkMethod)]
FIXED = [name for name in METHODS if name not in LEARNED]

#: Those whose output a map takes.
MAPPED = ("deepring",)


@pytest.fixture(scope="module")
def network_files(tmp_path_factory):
    """A file of each network at a tiny size."""
    folder = tmp_path_factory.mktemp("networks")
    for name in LEARNED:
        write_network(
            folder / f"{name}.safetensors", TrainedNetwork(TINY[name](), "campus", "Loss")
        )
    return folder


def refused_in_one_line(done, folder, *words):
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert all(word in line for word in words), line
    assert any(sign in line for sign in ("expected", "; "))
    assert not list(folder.iterdir())


@pytest.mark.parametrize("name", LEARNED)
def test_a_network_is_mapped_or_refused(name, network_files, tiny_nclt, tmp_path):
    file = network_files / f"{name}.safetensors"
    drive = (tiny_nclt, "--session", "2031-02-04")
    done = deepring("map", "build", *drive, "--checkpoint", file, "-o", "own.map", cwd=tmp_path)
    if name in MAPPED:
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "own.map").is_file()
        return
    refused_in_one_line(done, tmp_path, "expected DeepRING", "deepring evaluate")


@pytest.mark.parametrize("name", FIXED)
def test_what_learns_nothing_has_no_checkpoint_to_build_a_map_from(name, tiny_nclt, tmp_path):
    done = deepring("map", "build", tiny_nclt, "--checkpoint", name, "-o", "own.map", cwd=tmp_path)
    refused_in_one_line(done, tmp_path, f"checkpoint {name}: the name of a method", "has none")


@pytest.mark.parametrize("name", LEARNED)
def test_a_network_is_no_map_to_locate_in(name, network_files, tiny_nclt, tmp_path):
    scan = next(tiny_nclt.rglob("velodyne_sync/*.bin"))
    done = deepring(
        *("localize", network_files / f"{name}.safetensors", scan, "--format", "nclt"), cwd=tmp_path
    )
    refused_in_one_line(done, tmp_path, f"{name}.safetensors")


@pytest.mark.parametrize("name", LEARNED)
def test_a_network_is_exported_and_as_onnx_where_it_has_such_a_form(name, network_files, tmp_path):
    file = network_files / f"{name}.safetensors"
    assert deepring("export", file, "-o", "again.safetensors", cwd=tmp_path).returncode == 0
    (tmp_path / "again.safetensors").unlink()
    if not hasattr(TINY[name](), "onnx_form"):
        done = deepring("export", file, "-o", "own.onnx", cwd=tmp_path)
        refused_in_one_line(done, tmp_path, "has no ONNX form", "export it as .safetensors")


#: Those whose comparison has weights, which are in no file of descriptors.
BY_WEIGHTS = ("overlapnet", "rinet")


@pytest.mark.usefixtures("wide")
def test_descriptors_are_not_scored_without_the_weights_that_compare_them(tmp_path):
    """`test_scoring` has both of them, in Python."""
    method, empty = TINY["rinet"](), tmp_path / "empty"
    task = road_task(method.raster)
    evaluate_method(task.case("RINet", "city"), method, task, export=tmp_path / "run")
    empty.mkdir()
    done = deepring("score", tmp_path / "run", cwd=empty)
    refused_in_one_line(done, empty, "rinet compares with its weights", "score_descriptors")


def test_the_docs_say_what_can_be_done_with_each_method():
    """The table of docs/methods/index.md, against what the methods offer."""
    text = (Path(__file__).parents[2] / "docs" / "methods" / "index.md").read_text()
    lines = text.partition("| method | turn | relative pose |")[2].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    found = {row[0].strip("`"): row[1:] for row in rows[: lines.index("")]}
    assert found == {name: said_of(name) for name in METHODS}


def said_of(name):
    """The cells of a method: its turn, pose, scored descriptors, files and map."""
    method = TINY[name]()
    images = torch.from_numpy(np.stack([seen_by(method, seed) for seed in (0, 1)]))
    descriptors = method.describe(images)
    turn = method.compare(descriptors, descriptors).turn
    period = getattr(method, "turn_period", math.tau)
    files = ["`.safetensors`"] * (name in LEARNED) + ["`.onnx`"] * hasattr(method, "onnx_form")
    return [
        "-" if turn is None else "yes" if period == math.tau else "modulo 180°",
        "yes" if isinstance(method, RelativePoses) else "-",
        "with the network alone" if name in BY_WEIGHTS else "yes",
        ", ".join(files) or "-",
        "yes" if name in MAPPED else "-",
    ]


def seen_by(method, seed):
    return method.raster(with_columns(walls(seed), method.raster.columns), 0.0)


def test_compare_takes_every_method():
    """`test_methods` trains each; the others are evaluated by what this finds."""
    entries = method_entries(config_folder())
    taken = {
        entry.target
        for kind in ("learned", "fixed")
        for entry in entries
        if entry.name in every_method(kind, entries, lambda _: {}).names
    }
    assert taken == set(packaged_methods().values())
