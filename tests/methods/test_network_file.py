"""A network in a safetensors file is the same network; other files say what they are."""

import pytest
import torch
from safetensors.torch import save_file

from deepring.errors import FileError
from deepring.methods.deepring import DeepRing
from deepring.methods.network_file import (
    TrainedNetwork,
    load_network,
    read_network,
    shipped_network,
    write_network,
)
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.rasters import BevRaster, PointsRaster, raster_settings
from helpers.networks import deepring_settings
from helpers.sealed_files import parts_of, rewritten


def small():
    raster = raster_settings(BevRaster())
    return DeepRing(deepring_settings(raster, pool=2, widths=(4, 8), convolutions=1)).eval()


@pytest.fixture
def written(tmp_path):
    write_network(
        tmp_path / "a.safetensors", TrainedNetwork(small(), "campus+city", "CrossEntropy")
    )
    return tmp_path / "a.safetensors"


def images(n=2):
    return torch.rand(n, 120, 120, generator=torch.Generator().manual_seed(0)) < 0.05


def test_written_and_read_it_describes_the_same(tmp_path):
    network = small()
    write_network(tmp_path / "a.safetensors", TrainedNetwork(network, "campus", "CrossEntropy"))
    again, trained_on, loss, _ = load_network(tmp_path / "a.safetensors")
    assert torch.equal(again.describe(images()), network.describe(images()))
    assert (trained_on, loss) == ("campus", "CrossEntropy")
    assert not again.training


def test_other_methods_travel_as_well(tmp_path):
    raster = raster_settings(PointsRaster(count=64))
    settings = PointNetVladSettings(raster, clusters=4)
    write_network(tmp_path / "p.safetensors", TrainedNetwork(PointNetVlad(settings), "campus", "L"))
    assert isinstance(read_network(tmp_path / "p.safetensors").method, PointNetVlad)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.9])
def test_a_file_cut_short(written, share):
    content = written.read_bytes()
    written.write_bytes(content[: int(share * len(content))])
    with pytest.raises(FileError, match="no complete safetensors file"):
        read_network(written)


def test_an_altered_weight_is_told_at_once(written):
    content = bytearray(written.read_bytes())
    content[-3] ^= 1
    written.write_bytes(content)
    with pytest.raises(FileError, match="was altered"):
        read_network(written)


def test_files_that_are_none(written, tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_network(tmp_path / "none.safetensors")
    save_file({"x": torch.zeros(1)}, tmp_path / "x.safetensors")
    with pytest.raises(FileError, match="that deepring did not write"):
        read_network(tmp_path / "x.safetensors")
    save_file({"x": torch.zeros(1)}, tmp_path / "x.safetensors", {"deepring_network": "{}"})
    with pytest.raises(FileError, match=r"by an earlier version.*; export it again"):
        read_network(tmp_path / "x.safetensors")
    rewritten(written, stated={"version": 99})
    with pytest.raises(FileError, match="format version 99, expected 2; export it again"):
        read_network(written)


@pytest.mark.parametrize(
    "change",
    [
        {"network": 3},
        {"network": {}},
        {"network": {"settings": {}}},
        {"network": None},
        {"trained_on": 1},
        {"loss": None},
        {"extra": 1},
    ],
)
def test_headers_that_no_network_has_are_refused(written, change):
    rewritten(written, values=change)
    with pytest.raises(FileError, match="export it again"):
        read_network(written)


@pytest.mark.parametrize("value", [None, -1, "wide", [], [0], [[]], {"a": 1}, 1e400])
@pytest.mark.parametrize("name", ["widths", "raster", "pool", "convolutions"])
def test_settings_of_other_types_are_refused(written, name, value):
    network = parts_of(written)[0]["values"]["network"]
    network["settings"][name] = value
    rewritten(written, values={"network": network})
    with pytest.raises(FileError, match="export it again"):
        read_network(written)


def test_weights_of_another_network_are_refused(written):
    weights = parts_of(written)[1]
    name = next(iter(weights))
    for change in ({"tensors": {name: torch.zeros(1, 2, 3)}}, {"lacking": [name]}):
        copy = written.with_name("b.safetensors")
        copy.write_bytes(written.read_bytes())
        rewritten(copy, **change)
        with pytest.raises(FileError, match="export it again"):
            read_network(copy)


def test_the_shipped_network_is_trained_and_small():
    network, trained_on, *_ = shipped_network()
    assert isinstance(network, DeepRing)
    assert sum(p.numel() for p in network.parameters()) < 100_000
    assert "campus" in trained_on
    assert "city" in trained_on
    assert load_network("shipped").method.settings == network.settings
