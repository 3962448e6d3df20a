"""Points of a map's places: thinned, in their own frames, the same however they are stored."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DataError, FileError
from deepring.localization.map import Map
from deepring.localization.place_points import COUNTS, STEP, VOXEL, XYZ, PlacePoints, thinned_points
from deepring.testing import walls
from helpers.networks import small_network
from helpers.sealed_files import parts_of, rewritten

NETWORK = small_network()


def poses(count):
    """Poses 30 m apart."""
    every = np.tile(np.eye(4), (count, 1, 1))
    every[:, 0, 3] = 30.0 * np.arange(count)
    return every


def map_of(scans):
    place_map = Map(NETWORK, points=True)
    place_map.add(scans, poses(len(scans)), [f"{k}" for k in range(len(scans))])
    return place_map


def metres(points):
    return points.astype(np.float64) * STEP


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.integers(1, 400))
def test_each_voxel_keeps_the_mean_of_its_points(seed, count):
    points = np.random.default_rng(seed).normal(scale=3, size=(count, 3)).astype(np.float32)
    thinned = metres(thinned_points(points))
    voxel = np.floor(points / np.float32(VOXEL))
    means = [points[(voxel == one).all(axis=1)].mean(axis=0) for one in np.unique(voxel, axis=0)]
    assert len(thinned) == len(means)
    np.testing.assert_allclose(thinned, means, atol=STEP / 2 + 1e-4)


def test_points_beyond_the_reach_of_their_numbers_are_dropped():
    far = np.float32([[327, 0, 0], [0, -327, 0], [328, 0, 0], [0, 0, 1e6], [0, 0, -40]])
    np.testing.assert_allclose(sorted(map(tuple, metres(thinned_points(far)))),
                               [(0, -327, 0), (0, 0, -40), (327, 0, 0)])  # fmt: skip
    assert thinned_points(np.full((2, 3), 1e9, np.float32)).shape == (0, 3)


@pytest.mark.parametrize("counts", [(1, 1, 1), (3,), (0, 2, 1)])
def test_a_map_keeps_the_points_of_each_place_however_it_is_stored(counts, tmp_path):
    scans = [walls(k) for k in range(3)]
    grown, start = Map(NETWORK, points=True), 0
    for count in counts:
        part = slice(start, start + count)
        names = [f"{k}" for k in range(3)][part]
        grown.add_observation(grown.observe(scans[part]), poses(3)[part], names, scans[part])
        start += count
    grown.save(tmp_path / "a.map")
    for place_map in (grown, Map.open(tmp_path / "a.map", check=True), map_of(scans)):
        assert len(place_map.points) == 3
        for k, scan in enumerate(scans):
            np.testing.assert_allclose(
                place_map.points.of(k), metres(thinned_points(scan)), atol=1e-5
            )
    opened = Map.open(tmp_path / "a.map")
    opened.add([walls(7)], poses(1), ["further"])  # behind what is memory-mapped
    opened.save(tmp_path / "b.map")
    np.testing.assert_array_equal(Map.open(tmp_path / "b.map").points.of(3), opened.points.of(3))


def test_a_map_without_points_stays_as_it_is(tmp_path):
    place_map = Map(NETWORK)
    place_map.add([walls(0)], poses(1), ["a"])
    place_map.save(tmp_path / "a.map")
    assert place_map.points is None
    assert Map.open(tmp_path / "a.map").points is None
    assert XYZ not in parts_of(tmp_path / "a.map")[1]
    empty = Map(NETWORK, points=True)
    empty.save(tmp_path / "empty.map")
    assert len(Map.open(tmp_path / "empty.map").points) == 0


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (None, "points: None, expected those of each scan"),
        ([walls(0)], "points: 1 scans, expected 2"),
        ([walls(0), np.zeros((3, 2))], r"points\[1\]: shape \(3, 2\)"),
        ([walls(0), np.full((3, 3), np.nan)], r"points\[1\]"),
    ],
)
def test_nothing_is_added_without_the_points_of_each_place(points, words):
    place_map = map_of([walls(3)])
    seen = place_map.observe([walls(0), walls(1)])
    with pytest.raises(DataError, match=words):
        place_map.add_observation(seen, poses(2), ["a", "b"], points)
    assert len(place_map) == len(place_map.points) == len(place_map.index) == 1


def test_what_fails_takes_the_points_back(monkeypatch):
    place_map = map_of([walls(3)])

    def add_and_fail():
        with place_map.all_or_nothing():
            place_map.add([walls(0)], poses(1), ["a"])
            raise RuntimeError

    with pytest.raises(RuntimeError):
        add_and_fail()
    assert len(place_map.points) == len(place_map) == 1


def negative(counts):
    counts[0], counts[1] = -1, counts[0] + counts[1] + 1
    return counts


@pytest.mark.parametrize(
    ("tensors", "lacking", "words"),
    [
        ({}, [XYZ], "points: one tensor"),
        ({}, [COUNTS], "points: one tensor"),
        ({COUNTS: lambda c: c[:-1].contiguous()}, [], "points.counts"),
        ({COUNTS: lambda c: c + 1}, [], "points: counts of 3 places"),
        ({COUNTS: negative}, [], "points: counts of 3 places"),
        ({COUNTS: lambda c: c.long()}, [], "is int64|int64 of shape"),
        ({XYZ: lambda x: x.float()}, [], "float32 of shape"),
        ({XYZ: lambda x: x[:, :2].contiguous()}, [], "points.xyz"),
    ],
)
def test_points_that_are_not_those_of_the_places_are_refused(tensors, lacking, words, tmp_path):
    path = tmp_path / "a.map"
    map_of([walls(k) for k in range(3)]).save(path)
    whole = parts_of(path)[1]
    changed = {name: change(whole[name].clone()) for name, change in tensors.items()}
    rewritten(path, tensors=changed, lacking=lacking)
    with pytest.raises(FileError, match=words):
        Map.open(path)


def test_restored_points_are_not_copied():
    tensors = {XYZ: torch.ones(5, 3, dtype=torch.int16), COUNTS: torch.tensor([2, 3]).int()}
    points = PlacePoints.restored(tensors, 2)
    tensors[XYZ][3] = 7
    assert points.of(1)[1].tolist() == pytest.approx([0.07] * 3)
