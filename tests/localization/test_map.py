"""A map built of one drive locates scans of another; files that are damaged say so."""

import json
import math

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from deepring.core.rigid import turn_points, yaw_of
from deepring.data.readers.nclt import open_nclt
from deepring.errors import DeepringError
from deepring.localization.candidates import RerankSettings
from deepring.localization.map import AcceptanceThresholds, Map
from deepring.methods.deepring import DeepRing
from deepring.rasters.kinds import BevRaster, raster_settings
from deepring.search.correlation_index import SearchSettings
from helpers.networks import deepring_settings


def small_network(seed=0, **settings):
    torch.manual_seed(seed)
    raster = raster_settings(BevRaster())
    return DeepRing(deepring_settings(raster, pool=2, widths=(4, 8), convolutions=1, **settings))


@pytest.fixture(scope="module")
def drives(tiny_nclt):
    return [open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17")]


@pytest.fixture(scope="module")
def built(drives):
    # The network is not trained: what it takes for alike is little better than chance.
    rerank = RerankSettings(candidates=100)
    return Map.build(drives[0], small_network(), spacing=5.0, rerank=rerank)


@pytest.mark.parametrize("turn", [0.0, 2.0, -2.9])
def test_scans_of_another_drive_are_located(built, drives, turn):
    second = drives[1]
    for k in range(0, len(second.files), max(1, len(second.files) // 6)):
        found = built.localize(turn_points(second.points(k), turn))
        assert math.hypot(*(second.positions[k] - [found.x, found.y])) < 2.0
        # Points that are turned by +turn are those of a sensor that looks -turn away.
        heading = float(yaw_of(second.poses[k])) - turn
        off = (found.yaw - heading + math.pi) % (2 * math.pi) - math.pi
        assert abs(off) < math.radians(5)
        assert found.name == built.names[found.place]
        assert 0 < found.fit <= 1


def test_a_scan_may_have_its_ground_elsewhere(built, drives):
    points = drives[1].points(3)
    higher = points - np.float32([0, 0, 30])  # of a sensor 30 m higher
    found = built.localize(higher, ground_z=built.ground_z - 30)
    usual = built.localize(points)
    assert found.fit == pytest.approx(usual.fit, abs=0.02)
    assert math.hypot(found.x - usual.x, found.y - usual.y) < 0.5
    # Nearly all of it is below the ground that the map was built with.
    assert built.localize(higher).fit < 0.5 * usual.fit


def test_trust_asks_for_both(built, drives):
    points = drives[1].points(3)
    sure = built.localize(points)
    usual = AcceptanceThresholds()
    assert sure.trusted == (sure.fit >= usual.fit and sure.ratio >= usual.ratio)
    for trust in (AcceptanceThresholds(fit=1.1), AcceptanceThresholds(ratio=math.inf)):
        built.trust, usual = trust, built.trust
        assert not built.localize(points).trusted or trust.ratio == sure.ratio
        built.trust = usual
    noise = np.random.default_rng(0).uniform(-60, 60, (500, 3)).astype(np.float32)
    assert not built.localize(noise).trusted


def test_saved_and_opened_it_locates_the_same(built, drives, tmp_path):
    built.save(tmp_path / "a.map")
    opened = Map.open(tmp_path / "a.map", check=True)
    assert len(opened) == len(built)
    assert (opened.rerank, opened.trust) == (built.rerank, built.trust)
    for k in (0, 4):
        assert opened.localize(drives[1].points(k)) == built.localize(drives[1].points(k))
    # It goes on growing, and is saved again in place.
    opened.add([drives[1].points(2)], drives[1].poses[2:3], ["further"])
    opened.save(tmp_path / "a.map")
    grown = Map.open(tmp_path / "a.map", check=True)
    assert len(grown) == len(built) + 1
    assert grown.localize(drives[1].points(2)).name == "further"


def test_the_network_travels_in_the_map(built, tmp_path):
    built.save(tmp_path / "a.map")
    weights = Map.open(tmp_path / "a.map").network.state_dict()
    assert all(torch.equal(weights[k], v) for k, v in built.network.state_dict().items())
    other = small_network(seed=1).state_dict()
    assert any(not torch.equal(weights[k], v) for k, v in other.items())


def test_an_empty_map_is_a_map_without_answers(tmp_path, drives):
    Map(small_network()).save(tmp_path / "empty.map")
    with pytest.raises(DeepringError, match="holds no places to look among"):
        Map.open(tmp_path / "empty.map").localize(drives[0].points(0))


def test_scans_without_points_or_numbers_are_refused(built):
    with pytest.raises(DeepringError, match=r"shape \(0, 3\)"):
        built.localize(np.zeros((0, 3), np.float32))
    points = np.ones((9, 3), np.float32)
    points[3, 0], points[5, 2] = np.nan, np.inf
    with pytest.raises(DeepringError, match="2 of 9 points"):
        built.localize(points)


def test_networks_that_no_map_is_made_of_are_refused():
    with pytest.raises(DeepringError, match="compared by l2"):
        Map(small_network(similarity="l2"))
    with pytest.raises(DeepringError, match=r"search\.precision"):
        Map(small_network(), search=SearchSettings("float64"))


@pytest.mark.parametrize("cut", [0, 7, 100, -1])
def test_files_cut_short_are_told(built, tmp_path, cut):
    path = tmp_path / "a.map"
    built.save(path)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(DeepringError, match=r"a\.map"):
        Map.open(path)


def test_altered_bytes_are_told_where_they_are_checked(built, tmp_path):
    path = tmp_path / "a.map"
    built.save(path)
    whole = bytearray(path.read_bytes())
    whole[-5] ^= 1
    path.write_bytes(whole)
    Map.open(path)
    with pytest.raises(DeepringError, match="was altered"):
        Map.open(path, check=True)


def rewritten(path, change):
    """The file again with another header."""
    with safe_open(path, framework="pt") as file:
        tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
        metadata = dict(file.metadata())
    sealed = json.loads(metadata["deepring_map"])
    header = json.loads(sealed["header"])
    change(header)
    sealed["header"] = json.dumps(header)
    save_file(tensors, path, {"deepring_map": json.dumps(sealed)})


def test_other_versions_and_altered_headers_are_told(built, tmp_path):
    path = tmp_path / "a.map"
    built.save(path)
    rewritten(path, lambda header: header.update(ground_z=9.0))
    with pytest.raises(DeepringError, match="its header was altered"):
        Map.open(path)
    rewritten(path, lambda header: header.update(version=99))
    with pytest.raises(DeepringError, match="format version 99, expected 2"):
        Map.open(path)
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(DeepringError, match="without a header of ours"):
        Map.open(path)
    with pytest.raises(DeepringError, match="no such file"):
        Map.open(tmp_path / "b.map")
