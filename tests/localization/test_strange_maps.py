"""Maps whose seals are whole and whose content is not: refused on opening, each by its fault."""

import copy
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import BrokenScanError, DeepringError, FileError
from deepring.localization.map import Map
from deepring.testing import walls
from helpers.networks import small_network
from helpers.sealed_files import parts_of, put_together, rewritten

PLACES = 4


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    poses = np.tile(np.eye(4), (PLACES, 1, 1))
    poses[:, 0, 3] = 30.0 * np.arange(PLACES)
    place_map = Map(small_network())
    place_map.add([walls(k) for k in range(PLACES)], poses, [f"{k}.bin" for k in range(PLACES)])
    path = tmp_path_factory.mktemp("strange") / "good.map"
    place_map.save(path)
    return path


@pytest.fixture
def strange(written, tmp_path):
    (tmp_path / "a.map").write_bytes(written.read_bytes())
    return tmp_path / "a.map"


def changed(values, path, value):
    """The header's values with another one at a dotted path."""
    values = copy.deepcopy(values)
    inner = values
    *outer, last = path.split(".")
    for name in outer:
        inner = inner[name]
    inner[last] = value
    return values


SETTINGS = "network.settings."


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("ground_z", 1e300, r"ground_z: 1e\+300, expected a number of metres from"),
        ("thresholds.fit", -0.5, r"thresholds\.fit: -0\.5, expected a number of at least 0"),
        ("thresholds.ratio", math.nan, "JSON: NaN"),
        ("thresholds.ratio", math.inf, "JSON: Infinity"),
        ("search.candidates", -1, r"search\.candidates: -1"),
        ("search.candidates", 2**70, "64 bits"),
        ("search.candidate_share", 1.5, r"search\.candidate_share: 1\.5, expected a share"),
        ("search.exhaustive_below", -1, r"search\.exhaustive_below: -1"),
        ("search.code.frequencies", 10**9, r"search\.code\.frequencies: 1000000000, .* at most"),
        ("search.code.components", 3, "code: basis and step of shapes"),
        ("rerank.candidates", 10**9, r"rerank\.candidates: 1000000000, expected at most"),
        ("rerank.close", 0.0, r"rerank\.close: 0\.0"),
        ("rerank.apart", -1.0, r"rerank\.apart: -1\.0"),
        ("rerank.alignment.padded", 10**6, r"alignment\.padded: 1000000, expected at most"),
        ("rerank.alignment.step", 1e-9, r"alignment\.step: 1e-09, expected .* radians"),
        ("rerank.alignment.extent", 35.0, "images of 120 cells over 35 m, expected those of the"),
        ("rerank.alignment.cells", 60, "images of 60 cells over 70 m, expected those of the"),
        ("shape", [10**9, 31], r"shape: 1000000000, expected at most"),
        ("shape", [60, 30], r"shape: \(60, 30\), expected \(60, 31\)"),
        ("shape", [0, 31], r"shape: 0, expected a whole number of at least 1"),
        ("names", [f"{k}" for k in range(PLACES + 1)], "5 names"),
        ("network.method", "ring", "learns nothing, expected a NetworkMethod"),
        ("network.method", "disco", "settings"),
        ("network.method", "os.system", r"'os\.system' is not registered"),
        ("network.method", ["deepring"], "expected 'method' and 'settings'"),
        ("network.settings", None, "expected 'method' and 'settings'"),
        (SETTINGS + "raster.cells", 10**9, r"raster: .* values, expected at most"),
        (SETTINGS + "raster.cells", 60, r"alignment"),
        (SETTINGS + "raster.kind", "polar", "raster"),
        (SETTINGS + "raster.preprocessing.cell", 1e-9, r"preprocessing\.cell"),
        (SETTINGS + "raster.preprocessing.window", 10**9 + 1, r"preprocessing\.window"),
        (SETTINGS + "raster.preprocessing.height", [20, -5], r"preprocessing\.height"),
        (SETTINGS + "encoder.widths", [4, 10**9], r"encoder\.widths: \[4, 1000000000\]"),
        (SETTINGS + "encoder.widths", [4, 16], r"the weights are not those"),
        (SETTINGS + "encoder.convolutions", 10**9, r"encoder\.convolutions"),
        (SETTINGS + "encoder.stem", 0, r"encoder\.stem: 0"),
        (SETTINGS + "encoder.stem", 7, r"divide rows and columns by 14"),
        (SETTINGS + "representation.angles", 10**9, r"representation\.angles"),
        (SETTINGS + "representation.bins", -120, r"representation\.bins: -120"),
        (SETTINGS + "aggregation.kind", "exec", r"aggregation\.kind: 'exec'"),
        (SETTINGS + "similarity.kind", "l2", "expected a BevRaster and correlation"),
    ],
)
def test_values_out_of_range_are_named(strange, path, value, message):
    rewritten(strange, values=changed(parts_of(strange)[0]["values"], path, value))
    with pytest.raises(FileError, match=message) as raised:
        Map.open(strange)
    assert str(raised.value).startswith(f"map {strange}: ")
    assert len(str(raised.value)) < 1500


def turned_over(poses):
    poses[1, :3, :3] = torch.diag(torch.tensor([1.0, 1.0, -1.0]))
    return poses


def at(row, value):
    def change(tensor):
        tensor[row] = value
        return tensor

    return change


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("poses", at((0, 0, 3), math.nan), "tensor poses: values that are not finite"),
        ("poses", at((2, 3, 0), 1e-3), "poses: .* not rigid"),
        ("poses", lambda poses: poses * 2, "poses: 4 of 4 are not rigid"),
        ("poses", turned_over, "poses: 1 of 4 are not rigid"),
        ("index.scale", at((0, 0), math.nan), r"tensor index\.scale: values that are not finite"),
        (
            "index.scale",
            at((1, 2), -1.0),
            r"tensor index\.scale: a value of -1, expected at least 0",
        ),
        ("index.tails", at((1, 2), -1.0), r"tensor index\.tails: a value of -1"),
        ("index.values", lambda values: values.float(), "expected int8 values"),
        ("code.basis", at((0, 0), math.inf), r"tensor code\.basis: values that are not finite"),
        ("code.step", at((0, 0), 0.0), r"tensor code\.step: a value of 0, expected at least"),
        ("code.step", lambda step: step[:-1].contiguous(), r"code\.step|index\.code"),
        ("network.encoder.head.weight", lambda w: w * math.nan, "values that are not finite"),
        ("network.encoder.head.weight", lambda w: w.double(), "is float64"),
        ("images", lambda images: images[:, :-1].contiguous(), "images"),
    ],
)
def test_tensors_that_no_map_has_are_named(strange, name, change, message):
    rewritten(strange, tensors={name: change(parts_of(strange)[1][name])})
    with pytest.raises(FileError, match=message):
        Map.open(strange)


def test_places_that_compare_with_nothing_are_noticed_in_the_search(strange):
    """Values of large tensors are read where every byte is, or where they are compared."""
    place_map = Map(small_network(), search=Map.open(strange).index.settings)
    assert place_map.index.settings.precision == "int8"
    rewritten(strange, tensors={"index.scale": parts_of(strange)[1]["index.scale"] * 0 + 3e38})
    with pytest.raises(DeepringError, match="similarity is no finite number"):
        Map.open(strange).localize(walls(0))


def test_a_network_that_overflows_is_noticed_when_it_describes(strange):
    weights = {
        k: v for k, v in parts_of(strange)[1].items() if k.startswith("network.encoder.head")
    }
    rewritten(strange, tensors={name: weight * 0 + 3e38 for name, weight in weights.items()})
    with pytest.raises(DeepringError, match="not finite"):
        Map.open(strange).localize(walls(0))


EVIL = st.sampled_from(
    [
        *(None, True, 0, -1, 1, 2, 7, 121, 10**6, 2**62, -0.0, 0.5, -1.5, 1e-300, 1e300, -1e300),
        *("", "x", "../x", "\x1b[2J", "deepring", "int8", "float32", "full", "none", [], {}, [[]]),
        *([1], [2, 4], [0, 0], [10**9, 10**9], {"a": 1}, [None, None]),
    ]
)


def paths_in(value, path=()):
    """The paths to all values within a value."""
    inner = value.items() if isinstance(value, dict) else ()
    for key, each in enumerate(value) if isinstance(value, list) else inner:
        yield (*path, key)
        yield from paths_in(each, (*path, key))


@settings(deadline=None, max_examples=120)
@given(data=st.data())
def test_any_other_header_is_refused_or_locates(written, data):
    stated, tensors = parts_of(written)
    for _ in range(data.draw(st.integers(1, 2))):
        path = data.draw(st.sampled_from(list(paths_in(stated["values"]))))
        inner = stated["values"]
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = copy.deepcopy(data.draw(EVIL))  # the next change may be within it
    strange = put_together(written.with_name("any.map"), stated, tensors)
    try:
        place_map = Map.open(strange)
    except FileError:
        return
    try:
        location = place_map.localize(walls(1))
    except BrokenScanError:  # such as a band of heights below the walls
        return
    assert math.isfinite(location.x + location.y + location.yaw + location.fit)
    assert location.name == place_map.places.names[location.place]
