"""A fingerprint tells what made descriptors: class, raster, values, weights; and what differs."""

import json
import math

import numpy as np
import pytest
import torch
from torch import nn

from deepring.data.cache import RASTER_VERSION
from deepring.errors import DeepringError
from deepring.evaluation.fingerprint import digest_of, fingerprint, first_difference
from deepring.methods.deepring import DeepRing
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.rasters import BevRaster, ContextRaster, PolarRaster, Preprocessing, raster_settings
from helpers.networks import deepring_settings


def network(seed=0, **changes):
    torch.manual_seed(seed)
    raster = raster_settings(changes.pop("raster", BevRaster(cells=32)))
    values = {"raster": raster, "angles": 32, "bins": 32, "widths": (4, 6)}
    return DeepRing(deepring_settings(**{**values, **changes}))


def test_the_fingerprint_of_a_method_without_weights():
    assert fingerprint(Ring(angles=60)) == {
        "method": "ring",
        "raster": {**raster_settings(BevRaster()), "preprocessing": preprocessing()},
        "raster_version": RASTER_VERSION,
        "values": {"angles": 60, "bins": 120, "correlation": "paper"},
    }
    assert fingerprint(ScanContext(candidates=3))["values"] == {"candidates": 3}


def preprocessing():
    return {**vars(Preprocessing()), "height": [-5.0, 20.0]}


def test_the_fingerprint_of_a_network_counts_its_weights():
    ours = fingerprint(network())
    assert ours["method"] == "deepring"
    assert ours["settings"] == json.loads(json.dumps(network().settings.to_dict()))
    assert ours == fingerprint(network())
    assert first_difference(ours, fingerprint(network(seed=1)))[0] == "weights"
    changed = network()
    with torch.no_grad():
        next(changed.parameters()).view(-1)[0] += 1e-7
    assert fingerprint(changed) != ours
    without = {key: value for key, value in ours.items() if key != "weights"}
    assert fingerprint(changed.to("meta")) == without


def test_weights_of_every_type_and_shape_are_hashed_by_name_and_content():
    def digest(**tensors):
        return digest_of(tensors)

    half, flags = torch.ones(2, 3, dtype=torch.bfloat16), torch.tensor([True, False])
    ours = digest(a=half, b=flags, c=torch.tensor(3))
    assert ours == digest(c=torch.tensor(3), b=flags, a=half)
    assert ours == digest(a=half.T.contiguous().T, b=flags, c=torch.tensor(3))
    assert ours != digest(a=half.T, b=flags, c=torch.tensor(3))
    assert ours != digest(a=half, b=flags, d=torch.tensor(3))
    assert ours != digest(a=half, b=~flags, c=torch.tensor(3))
    assert digest(a=torch.ones(2)) == digest(a=np.ones(2, np.float32)) != digest(a=np.ones(2))


def test_the_first_difference_is_named_with_both_values():
    def differ(a, b):
        return first_difference(fingerprint(a), fingerprint(b))

    low = BevRaster(preprocessing=Preprocessing(height=(1.0, 20.0)))
    assert differ(Ring(), Ring()) is None
    assert differ(Ring(), Ring(low)) == ("raster.preprocessing.height", [-5, 20], [1, 20])
    assert differ(Ring(), Ring(angles=60)) == ("values.angles", 120, 60)
    assert differ(Ring(), ScanContext(ContextRaster())) == ("method", "ring", "scan_context")
    assert differ(network(), network(normalisation="standard")) == (
        "settings.similarity.normalisation",
        "unit",
        "standard",
    )
    assert first_difference({"a": {"b": 1}}, {"a": {}}) == ("a.b", 1, None)
    assert first_difference({"a": 1}, {"a": {"b": 1}}) == ("a", 1, {"b": 1})


class Mine:
    """A method of a user, as docs/architecture.md shows one."""

    def __init__(self, **attributes):
        self.raster = PolarRaster()
        self.__dict__.update(attributes)


def test_attributes_of_other_methods_count_unless_an_underscore_says_no():
    values = {"bands": (1, 2.5), "names": {"a": None}, "_cache": object()}
    assert fingerprint(Mine(**values))["values"] == {"bands": [1, 2.5], "names": {"a": None}}
    table = np.arange(6.0)
    ours, same = (fingerprint(Mine(table=t)) for t in (table, torch.from_numpy(table)))
    assert ours == same
    assert first_difference(ours, fingerprint(Mine(table=table + 1)))[0] == "values.table.sha256"


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (Mine(kernel=math.sin), r"Mine\.kernel: a builtin_function_or_method, expected a plain"),
        (Mine(deep={"a": [object()]}), r"Mine\.deep\.a: a object, expected a plain"),
        (Mine(raster=Preprocessing()), r"raster Preprocessing, expected one of bev"),
    ],
)
def test_what_cannot_be_stated_in_plain_values_is_refused(method, message):
    with pytest.raises(DeepringError, match=message):
        fingerprint(method)


def test_a_network_without_settings_is_refused():
    module = nn.Linear(2, 2)
    module.raster = BevRaster()
    with pytest.raises(DeepringError, match="settings None, expected PlainSettings"):
        fingerprint(module)


def test_a_fingerprint_is_of_plain_values_as_json_gives_them_back():
    for method in (network(), Ring(), Mine(bands=(1, 2))):
        made_by = fingerprint(method)
        assert json.loads(json.dumps(made_by)) == made_by
