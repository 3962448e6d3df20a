"""Files name methods by registered names; no name in a file is ever imported."""

import json
import subprocess
import sys

import lightning as L
import pytest
import torch

from deepring.errors import ConfigError, DeepringError
from deepring.methods import registry
from deepring.methods.deepring import DeepRing
from deepring.methods.method import Method
from deepring.methods.network import network_class
from deepring.methods.network_file import (
    TrainedNetwork,
    describe_network,
    load_network,
    make_network,
    weights_of,
    write_network,
)
from deepring.methods.registry import (
    method_class,
    method_name,
    register_method,
    registered_methods,
)
from deepring.methods.ring import Ring
from deepring.training.episodes import EpisodeScheme, OneShotCrossEntropy
from deepring.training.module import PlaceModule
from helpers.tiny_methods import TINY, deepring


class Own(DeepRing):
    """A user's network."""


@pytest.fixture
def free_registry(monkeypatch):
    monkeypatch.setattr(registry, "_METHODS", dict(registry._METHODS))


def write_checkpoint(folder, method):
    trainer = L.Trainer(accelerator="cpu", logger=False, enable_checkpointing=False)
    module = PlaceModule(method, EpisodeScheme(), OneShotCrossEntropy(), trained_on="campus")
    trainer.strategy.connect(module)
    trainer.save_checkpoint(folder / "last.ckpt")
    return folder / "last.ckpt"


def write_file(folder, method):
    write_network(folder / "own.safetensors", TrainedNetwork(method, "campus", "L"))
    return folder / "own.safetensors"


WRITERS = [write_checkpoint, write_file]


@pytest.mark.parametrize("name", registered_methods())
def test_names_and_classes_of_known_methods(name):
    method = TINY[name]()
    assert isinstance(method, Method)
    assert method_class(name) is type(method)
    assert method_name(type(method)) == name


def test_a_registered_class_is_found_by_its_name(free_registry):
    assert method_name(Own) == "test_registry.Own"
    register_method("own", Own)
    register_method("own", Own)  # again: a module may be imported twice
    assert (method_class("own"), method_name(Own)) == (Own, "own")
    with pytest.raises(ConfigError, match=r"'own' is registered for test_registry\.Own, expected"):
        register_method("own", Ring)
    with pytest.raises(ConfigError, match=r"name: 'own\.Own', expected letters"):
        register_method("own.Own", Own)


def test_names_that_are_not_registered_are_refused_with_what_to_do():
    with pytest.raises(
        ConfigError,
        match=r"'os\.system' is not registered; .*register_method.*`own_class`",
    ):
        method_class("os.system")
    assert method_class("test_registry.Own", Own) is Own
    assert method_class("test_registry.Own", "test_registry.Own") is Own
    with pytest.raises(ConfigError, match=r"'a\.B' is not registered, and the class given is test"):
        method_class("a.B", Own)


def test_dotted_paths_that_a_user_gives():
    assert network_class("test_registry.Own") is Own
    for path in ("nowhere.Net", "Net", "deepring.methods.ring.Rang", ""):
        with pytest.raises(ConfigError, match="cannot be imported, expected the dotted path"):
            network_class(path)
    with pytest.raises(ConfigError, match="Ring learns nothing, expected a NetworkMethod"):
        network_class("deepring.methods.ring.Ring")


def test_a_file_imports_nothing(tmp_path, monkeypatch):
    """The usual misreading: a name with a dot is looked up as a module."""
    (tmp_path / "trap.py").write_text("raise SystemExit('imported')\nclass Net: pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    described = {**describe_network(deepring()), "method": "trap.Net"}
    with pytest.raises(ConfigError, match=r"'trap\.Net' is not registered"):
        make_network(described, {})
    assert "trap" not in sys.modules


@pytest.mark.parametrize("write", WRITERS)
def test_a_network_of_ones_own_is_loaded_with_its_class_alone(write, tmp_path):
    network = Own(deepring().settings).eval()
    path = write(tmp_path, network)
    with pytest.raises(DeepringError, match=r"'test_registry\.Own' is not registered"):
        load_network(path)
    with pytest.raises(DeepringError, match="the class given is deepring"):
        load_network(path, DeepRing)
    loaded = load_network(path, Own)
    assert type(loaded.method) is Own
    assert loaded.trained_on == "campus"
    images = torch.rand(2, 24, 24) < 0.1
    assert torch.equal(loaded.method.describe(images), network.describe(images))


@pytest.mark.parametrize("write", WRITERS)
def test_a_known_network_needs_no_class(write, tmp_path):
    assert type(load_network(write(tmp_path, deepring())).method) is DeepRing


def test_what_was_no_network_is_refused():
    network = deepring()
    good, weights = describe_network(network), weights_of(network)
    assert json.loads(json.dumps(good)) == good
    assert make_network(good, weights).settings == network.settings
    with pytest.raises(ConfigError, match="expected 'method' and 'settings'"):
        make_network({"class": "deepring.methods.deepring.DeepRing"}, weights)
    with pytest.raises(DeepringError, match="Ring learns nothing"):
        make_network({**good, "method": "ring"}, weights)
    with pytest.raises(DeepringError, match="the weights are not those of DeepRING"):
        make_network(good, dict(list(weights.items())[1:]))
    with pytest.raises(DeepringError, match=r"settings\.depth: unknown, expected"):
        make_network({**good, "settings": {**good["settings"], "depth": 3}}, weights)


def test_loading_a_network_needs_no_lightning(tmp_path):
    checkpoint = write_checkpoint(tmp_path, deepring())
    code = (
        "import sys\n"
        "from deepring.methods.network_file import load_network\n"
        f"load_network('shipped'), load_network({str(checkpoint)!r})\n"
        "heavy = ('lightning', 'torchmetrics', 'hydra', 'matplotlib', 'omegaconf')\n"
        "print([name for name in heavy if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
