"""A map place_map of one drive locates scans of another; files that are damaged say so."""

import math

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from deepring.core.rigid import turn_points, yaw_of
from deepring.data.readers.nclt import open_nclt
from deepring.errors import BrokenScanError, DeepringError, FileError
from deepring.localization import candidate_search
from deepring.localization.candidates import RerankSettings
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.localization.map_building import build_map
from deepring.localization.observation import Observation
from deepring.search.search_settings import SearchSettings
from helpers.networks import small_network
from helpers.sealed_files import parts_of, rewritten


@pytest.fixture(scope="module")
def drives(tiny_nclt):
    return [open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17")]


@pytest.fixture(scope="module")
def place_map(drives):
    # The network is not trained: what it takes for alike is little better than chance.
    rerank = RerankSettings(candidates=100)
    return build_map(drives[0], small_network(), spacing=5.0, rerank=rerank)


@pytest.mark.parametrize("turn", [0.0, 2.0, -2.9])
def test_scans_of_another_drive_are_located(place_map, drives, turn):
    second = drives[1]
    for k in range(0, len(second.files), max(1, len(second.files) // 6)):
        location = place_map.localize(turn_points(second.points(k), turn))
        assert math.hypot(*(second.positions[k] - [location.x, location.y])) < 2.0
        # Points that are turned by +turn are those of a sensor that looks -turn away.
        heading = float(yaw_of(second.poses[k])) - turn
        off = (location.yaw - heading + math.pi) % (2 * math.pi) - math.pi
        assert abs(off) < math.radians(5)
        assert location.name == place_map.places.names[location.place]
        assert 0 < location.fit <= 1


def test_a_map_that_grows_place_by_place_copies_each_a_few_times(monkeypatch):
    copied = 0
    copy, cat = torch.Tensor.copy_, torch.cat

    def counted(self, other, *args):
        nonlocal copied
        copied += other.numel() * other.element_size()
        return copy(self, other, *args)

    def joined(tensors, *args, **kwargs):
        nonlocal copied
        out = cat(tensors, *args, **kwargs)
        copied += out.numel() * out.element_size()
        return out

    monkeypatch.setattr(torch.Tensor, "copy_", counted)
    monkeypatch.setattr(torch, "cat", joined)
    growing = Map(small_network())
    images = np.zeros((1, *growing.raster.shape), dtype=np.bool_)
    images[0, :10, 60] = True
    shape = growing.network.descriptor_shape
    generator, pose = torch.Generator().manual_seed(0), np.eye(4)[None]
    for k in range(120):
        one = torch.rand(1, *shape, generator=generator)
        growing.add_observation(Observation(images, one), pose, [str(k)])
    held = copied
    size = sum(t.nbytes for block in growing.index.places.blocks() for t in block.values())
    size += sum(t.nbytes for t in growing.places.tensors().values())
    assert size <= held < 4 * size  # copying all others each time takes 60 times the size


def test_a_scan_may_have_its_ground_elsewhere(place_map, drives):
    points = drives[1].points(3)
    higher = points - np.float32([0, 0, 30])  # of a sensor 30 m higher
    location = place_map.localize(higher, ground_z=place_map.ground_z - 30)
    usual = place_map.localize(points)
    assert location.fit == pytest.approx(usual.fit, abs=0.02)
    assert math.hypot(location.x - usual.x, location.y - usual.y) < 0.5
    # All of it is below the ground that the map was built with.
    with pytest.raises(BrokenScanError, match=r"nothing stands out .* ground_z = 0 m.* -30"):
        place_map.localize(higher)


def test_a_trusted_location_reaches_both_thresholds(place_map, drives):
    points = drives[1].points(3)
    sure = place_map.localize(points)
    usual = AcceptanceThresholds()
    assert sure.trusted == (sure.fit >= usual.fit and sure.ratio >= usual.ratio)
    for thresholds in (AcceptanceThresholds(fit=1.1), AcceptanceThresholds(ratio=math.inf)):
        place_map.thresholds, usual = thresholds, place_map.thresholds
        assert not place_map.localize(points).trusted or thresholds.ratio == sure.ratio
        place_map.thresholds = usual
    noise = np.random.default_rng(0).uniform(-60, 60, (500, 3)).astype(np.float32)
    assert not place_map.localize(noise).trusted


def test_an_observed_scan_is_located_and_added_as_its_points_are(drives):
    scans, poses = [drives[0].points(k) for k in range(3)], drives[0].poses[:3]
    by_points, by_images = Map(small_network()), Map(small_network())
    for scan, pose, name in zip(scans, poses, "abc", strict=True):
        by_points.add([scan], pose[None], [name])
        by_images.add_observation(by_images.observe([scan]), pose[None], [name])
    query = drives[1].points(0)
    location = by_points.localize(query)
    assert by_images.localize_observation(by_images.observe([query])) == location
    above = by_points.ground_z + 8
    seen = by_points.localize_observation(by_points.observe([query], above))
    assert seen == by_points.localize(query, ground_z=above) != location


def test_saved_and_opened_it_locates_the_same(place_map, drives, tmp_path):
    place_map.save(tmp_path / "a.map")
    opened = Map.open(tmp_path / "a.map", check=True)
    assert len(opened) == len(place_map)
    assert (opened.rerank, opened.thresholds) == (place_map.rerank, place_map.thresholds)
    for k in (0, 4):
        assert opened.localize(drives[1].points(k)) == place_map.localize(drives[1].points(k))
    # It goes on growing, and is saved again in place.
    opened.add([drives[1].points(2)], drives[1].poses[2:3], ["further"])
    opened.save(tmp_path / "a.map")
    grown = Map.open(tmp_path / "a.map", check=True)
    assert len(grown) == len(place_map) + 1
    assert grown.localize(drives[1].points(2)).name == "further"


def test_the_network_travels_in_the_map(place_map, tmp_path):
    place_map.save(tmp_path / "a.map")
    weights = Map.open(tmp_path / "a.map").network.state_dict()
    assert all(torch.equal(weights[k], v) for k, v in place_map.network.state_dict().items())
    other = small_network(seed=1).state_dict()
    assert any(not torch.equal(weights[k], v) for k, v in other.items())


def test_an_empty_map_is_a_map_without_answers(tmp_path, drives):
    Map(small_network()).save(tmp_path / "empty.map")
    with pytest.raises(DeepringError, match="holds no places to compare with"):
        Map.open(tmp_path / "empty.map").localize(drives[0].points(0))


def test_scans_without_points_are_refused(place_map):
    with pytest.raises(BrokenScanError, match="scan: no points; expected at least one"):
        place_map.localize(np.zeros((0, 3), np.float32))
    with pytest.raises(BrokenScanError, match="9 records, all missing returns"):
        place_map.localize(np.full((9, 3), np.nan, np.float32))


def test_networks_that_no_map_is_made_of_are_refused():
    with pytest.raises(DeepringError, match="compared by l2"):
        Map(small_network(similarity="l2"))
    with pytest.raises(DeepringError, match=r"search\.precision"):
        Map(small_network(), search=SearchSettings("float64"))


@pytest.fixture
def saved(place_map, tmp_path):
    place_map.save(tmp_path / "a.map")
    return tmp_path / "a.map"


@pytest.mark.parametrize("cut", [0, 7, 100, -1])
def test_files_cut_short_are_told(saved, cut):
    saved.write_bytes(saved.read_bytes()[:cut])
    with pytest.raises(FileError, match=r"a\.map: no complete safetensors .*or build it again"):
        Map.open(saved)


def test_altered_bytes_are_told_where_they_are_checked(saved):
    whole = bytearray(saved.read_bytes())
    whole[-5] ^= 1
    saved.write_bytes(whole)
    Map.open(saved)
    with pytest.raises(FileError, match="was altered"):
        Map.open(saved, check=True)


def test_other_versions_and_kinds_are_told(saved):
    rewritten(saved, stated={"version": 99})
    with pytest.raises(FileError, match="format version 99, expected 5; build it again"):
        Map.open(saved)
    rewritten(saved, stated={"version": 3, "kind": "network"})
    with pytest.raises(FileError, match="a file of kind 'network'; expected a map"):
        Map.open(saved)
    save_file({"a": torch.zeros(1)}, saved)
    with pytest.raises(FileError, match="that deepring did not write"):
        Map.open(saved)
    save_file({"a": torch.zeros(1)}, saved, {"deepring_map": "{}"})
    with pytest.raises(FileError, match=r"by an earlier version.*; build it again"):
        Map.open(saved)
    with pytest.raises(FileError, match="no such file"):
        Map.open(saved.with_name("b.map"))


def refused(path, message):
    with pytest.raises(FileError, match=message) as raised:
        Map.open(path)
    assert str(raised.value).startswith(f"map {path}: ")
    assert str(raised.value).endswith("; build it again")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("ground_z", "low", r"header\.ground_z: 'low', expected a number"),
        ("ground_z", math.inf, "JSON: Infinity, expected finite"),
        ("search", 3, r"header\.search: 3, expected values by name"),
        ("search.precision", "bfloat16", "expected bfloat16 values"),
        ("search.code", None, "codes: present but"),
        ("rerank.candidates", 0, r"rerank\.candidates: 0"),
        ("rerank.alignment", {}, r"header\.rerank\.alignment: lacks cells, .*blur"),
        ("thresholds", {"fit": 1.0}, r"header\.thresholds: lacks ratio"),
        ("shape", [60, 31.5], r"header\.shape\[1\]: 31\.5"),
        ("shape", [10, 31], r"shape: \(10, 31\), expected \(60, 31\)"),
        ("shape", None, "shape: missing"),
        ("names", ["a"], "places: 1 names"),
        ("names", [1], r"header\.names\[0\]: 1, expected text"),
        ("network", {"class": 1, "settings": []}, "network"),
        ("more", 1, r"header\.more: unknown"),
    ],
)
def test_values_that_no_map_has_are_refused(saved, name, value, message):
    outer, _, inner = name.partition(".")
    if inner:
        value = {**parts_of(saved)[0]["values"][outer], inner: value}
    rewritten(saved, values={outer: value})
    refused(saved, message)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("images", lambda images: images[:, 1:], "images"),
        ("images", lambda images: images.short(), "images: int16"),
        ("poses", lambda poses: poses.float(), "poses: float32"),
        ("poses", lambda poses: poses[1:], "poses: .* n = "),
        ("poses", lambda poses: poses * math.nan, "not finite"),
        ("index.values", lambda values: values[..., 1:], "rows: shapes"),
        ("index.code", lambda code: code[:, 1:], "components = "),
        ("code.basis", lambda basis: basis[1:], r"code: .* \(\(30, 24\)"),
    ],
)
def test_tensors_that_no_map_has_are_refused(saved, name, change, message):
    rewritten(saved, tensors={name: change(parts_of(saved)[1][name])})
    refused(saved, message)


@pytest.mark.parametrize("name", ["index.scale", "index.values", "index.code", "code.basis"])
def test_a_map_without_one_of_its_tensors_is_refused(saved, name):
    rewritten(saved, lacking=[name])
    refused(saved, "codes: .* without their basis" if name == "code.basis" else "rows: shapes")


def test_tensors_are_missed_and_unknown_ones_named(saved):
    rewritten(saved, lacking=["poses"], tensors={"more": torch.zeros(1)})
    refused(saved, "lacks poses and has an unknown more")
    weights = {f"network.{name}": torch.zeros(1) for name in ("more", "even.more")}
    rewritten(saved, lacking=["more"], tensors={"poses": torch.zeros(1, 4, 4), **weights})
    refused(saved, "network|n = ")


@pytest.mark.parametrize("spread", [0.0, 5.0, 150.0])
def test_few_places_are_looked_up_first_and_the_answer_is_the_same(drives, spread, monkeypatch):
    rerank = RerankSettings(candidates=3, spread=spread)
    place_map = build_map(drives[0], small_network(), spacing=0.0, rerank=rerank)
    looked_up, search = [], place_map.index.search

    def counted(descriptors, k, **options):
        looked_up.append(k)
        return search(descriptors, k, **options)

    monkeypatch.setattr(place_map.index, "search", counted)
    found = [place_map.localize(drives[1].points(k)) for k in range(0, 12, 3)]
    first, most = candidate_search.SURPLUS
    assert looked_up.count(3 * first) == len(found)
    assert (3 * most in looked_up) == (spread == 150.0)
    monkeypatch.setattr(candidate_search, "SURPLUS", (most,))
    assert [place_map.localize(drives[1].points(k)) for k in range(0, 12, 3)] == found
