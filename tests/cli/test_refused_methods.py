"""Every method through every command: it works, or one line says why not and what to do instead."""

import pytest

from deepring.experiment.config_groups import config_folder
from deepring.experiment.entries import method_entries
from deepring.experiment.every_method import every_method
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import TrainedNetwork, write_network
from deepring.methods.registry import packaged_methods
from helpers.cli import deepring
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
