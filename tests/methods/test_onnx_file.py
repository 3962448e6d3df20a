"""The exported network gives what the network gives, for any batch, and says what made it."""

import json

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from release.requirements import project

from deepring.errors import DeepringError
from deepring.methods.deepring import DeepRing
from deepring.methods.deepring.polar_branch import PolarSettings
from deepring.methods.deepring.real_form import RealDeepRing
from deepring.methods.network_file import make_network
from deepring.methods.onnx_file import FIRST_TORCH, export_onnx
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.rasters import BevRaster, PointsRaster, PolarRaster, raster_settings
from helpers.networks import deepring_settings

PAIRS = {"aggregation": "cross_spectra", "gaps": [18, 36], "frequencies": 7}
POLAR = {"polar": PolarSettings(widths=(4, 6), rings=16)}


def network(cells=40, **settings):
    torch.manual_seed(0)
    raster = raster_settings(BevRaster(cells=cells))
    values = {"angles": 40, "bins": 40, "widths": (4, 8), "convolutions": 1, **settings}
    made = DeepRing(deepring_settings(raster, **values))
    made.train()
    for _ in range(3):  # statistics of the norms that are not those of the start
        made(images(8, cells).float())
    return made.eval()


def images(n, cells=40, seed=0):
    raster = BevRaster(cells=cells)
    rng = np.random.default_rng(seed)
    scans = [rng.normal(0, 30, (400, 3)).astype(np.float32) for _ in range(n)]
    return torch.from_numpy(np.stack([raster(scan, -9.0) for scan in scans]))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"pool": 2},
        {"bins": 60, "angles": 20},
        {"norm": "group"},
        {"stem": 2},
        PAIRS,
        POLAR,
        {**POLAR, "stem": 2},
    ],
)
def test_real_arithmetic_is_the_network(settings):
    made = network(**settings)
    seen = images(5)
    with torch.no_grad():
        assert torch.allclose(RealDeepRing(made)(seen.float()), made.describe(seen), atol=1e-5)


@pytest.fixture(scope="module", params=[{}, {**PAIRS, **POLAR}])
def exported(tmp_path_factory, request):
    made = network(pool=2, **request.param)
    path = tmp_path_factory.mktemp("onnx") / "network.onnx"
    export_onnx(made, path)
    return made, path


@pytest.mark.parametrize("batch", [1, 2, 7])
def test_onnxruntime_agrees_with_the_network(exported, batch):
    made, path = exported
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    seen = images(batch, seed=batch)
    (found,) = session.run(["descriptors"], {"images": seen.float().numpy()})
    assert np.abs(found - made.describe(seen).numpy()).max() < 1e-4


def test_no_operator_is_complex_and_the_file_says_what_made_it(exported):
    made, path = exported
    model = onnx.load(path)
    assert not {"DFT", "STFT"} & {node.op_type for node in model.graph.node}
    assert {node.domain for node in model.graph.node} <= {"", "ai.onnx"}
    described = json.loads(model.metadata_props[0].value)
    weights = made.state_dict()
    assert make_network(described, weights).settings == made.settings


def test_other_networks_are_refused(tmp_path):
    for settings in ({"aggregation": "gap"}, {"theta_range": "half"}, {"normalisation": "none"}):
        with pytest.raises(DeepringError, match="onnx: a network over BevRaster"):
            export_onnx(network(**settings), tmp_path / "a.onnx")
    raster = raster_settings(PolarRaster())
    polar = DeepRing(deepring_settings(raster, angles=None, bins=None, widths=(4,)))
    with pytest.raises(DeepringError, match="over PolarRaster"):
        RealDeepRing(polar)
    points = PointNetVlad(PointNetVladSettings(raster_settings(PointsRaster(count=64)), clusters=2))
    with pytest.raises(DeepringError, match="onnx: PointNetVLAD has no ONNX form"):
        export_onnx(points, tmp_path / "a.onnx")
    assert not list(tmp_path.iterdir())


def test_an_older_torch_is_refused_and_the_extra_asks_for_the_first(tmp_path, monkeypatch):
    monkeypatch.setattr(torch, "__version__", "2.6.0+cpu")
    with pytest.raises(DeepringError, match=r"torch 2\.6\.0\+cpu cannot .* 2\.7 or later; pip"):
        export_onnx(network(), tmp_path / "a.onnx")
    assert not list(tmp_path.iterdir())
    assert f"torch>={FIRST_TORCH}" in project()["optional-dependencies"]["onnx"]
