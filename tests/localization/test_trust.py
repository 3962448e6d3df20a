"""A location is trusted for what was compared: few cells fit each other by chance, and a scan that
fits one place in several positions fits none of them."""

import math

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from deepring.data.readers.kitti import open_kitti
from deepring.data.readers.nclt import open_nclt
from deepring.data.scans.scan_files import read_scan
from deepring.errors import ConfigError
from deepring.localization.drives.loops import LOOP_THRESHOLDS
from deepring.localization.location import (
    FEW_CELLS,
    FIT_TIMES_ROOT_OF_CELLS,
    AcceptanceThresholds,
)
from deepring.localization.map import Map
from deepring.localization.observation import LEAST_CELLS
from deepring.methods.network_file import load_network
from helpers.real_data import real_data
from helpers.scenes import scattered

values = st.one_of(st.floats(-1, 2), st.sampled_from([0.0, 0.21, 0.4, 1.41, math.inf, math.nan]))


@settings(derandomize=True, max_examples=300, deadline=None)
@given(
    fit=values,
    ratio=values,
    cells=st.sampled_from([0, FEW_CELLS - 1, FEW_CELLS, 160, 400, 9999]),
)
@example(fit=0.3, ratio=math.inf, cells=500)
@example(fit=0.3, ratio=math.nan, cells=500)
def test_a_location_is_trusted_or_has_one_doubt(fit, ratio, cells):
    for thresholds in (AcceptanceThresholds(), LOOP_THRESHOLDS, AcceptanceThresholds(0.0, 0.0)):
        expected = fit >= thresholds.fit and ratio >= thresholds.ratio and cells >= FEW_CELLS
        expected = expected and fit >= FIT_TIMES_ROOT_OF_CELLS / math.sqrt(cells)
        assert bool(thresholds.accept(fit, ratio, cells)) == expected
        assert (thresholds.doubt(fit, ratio, cells) is None) == expected
        several = thresholds.accept(*(np.array([value, value]) for value in (fit, ratio, cells)))
        assert several.tolist() == [expected, expected]


def test_what_is_doubted_is_named():
    usual = AcceptanceThresholds()
    assert usual.doubt(0.1, 9.0, 500) == usual.doubt(0.1, math.inf, 500) == "fit"
    assert usual.doubt(0.3, 1.2, 500) == usual.doubt(0.3, math.nan, 500) == "ratio"
    assert usual.doubt(0.9, 9.0, FEW_CELLS - 1) == "few cells"
    assert usual.doubt(math.nan, 9.0, 500) == "fit"
    # 200 cells ask for 0.28, 100 for 0.40; 400 and more for no more than the threshold.
    assert usual.doubt(0.28, 9.0, 200) == usual.doubt(0.39, 9.0, 100) == "few cells"
    assert usual.doubt(0.29, 9.0, 200) is usual.doubt(0.21, 9.0, 400) is None
    # A stricter map asks no less.
    assert AcceptanceThresholds(fit=0.5).doubt(0.45, math.inf, 500) == "fit"


@pytest.mark.parametrize("bad", [math.nan, "0.2", None, True])
def test_thresholds_are_numbers(bad):
    with pytest.raises(ConfigError, match=r"thresholds\.ratio: .*, expected a number"):
        AcceptanceThresholds(ratio=bad)
    with pytest.raises(ConfigError, match=r"thresholds\.fit"):
        AcceptanceThresholds(fit=bad)


@pytest.fixture(scope="module")
def network():
    return load_network("shipped").method


def lone(network, points, ground_z, places=1):
    """A map of one place, or of several at one spot."""
    place_map = Map(network, ground_z)
    place_map.add([points] * places, np.tile(np.eye(4), (places, 1, 1)), ["a"] * places)
    return place_map


@pytest.mark.parametrize("places", [1, 3])
def test_scans_of_elsewhere_are_not_trusted_in_a_map_of_one_place(network, places):
    place_map = lone(network, scattered(0), 0.0, places)
    assert place_map.localize(scattered(0)).trusted
    elsewhere = [place_map.localize(scattered(seed)) for seed in range(1, 12)]
    assert not any(location.trusted for location in elsewhere)
    assert all(0.5 < location.ratio < 2 for location in elsewhere)


def test_the_place_itself_is_trusted_in_a_map_of_one_place(network, tiny_nclt):
    first, second = (open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17"))
    place_map = lone(network, first.points(10), 0.0)
    assert place_map.localize(first.points(10)).trusted
    near = np.linalg.norm(second.positions - first.positions[10], axis=1).argmin()
    location = place_map.localize(second.points(int(near)))
    assert location.trusted
    assert location.doubt is None
    assert 1.41 <= location.ratio < math.inf


def between_walls(along=0.0, posts=()):
    """Two straight walls, 12 m apart, around a sensor ``along`` metres along them."""
    x = np.arange(-80, 80, 0.4)
    walls = [np.column_stack([x, np.full(len(x), y), np.full(len(x), 2.0)]) for y in (-6, 6)]
    things = [np.array([[px - along, py, 2.0]]) for px, py in posts]
    ground = np.random.default_rng(0).uniform(-60, 60, (4000, 2))
    floor = np.column_stack([ground, np.zeros(len(ground))])
    return np.concatenate([*walls, *things, floor]).astype(np.float32)


def test_where_along_two_straight_walls_is_not_trusted(network):
    """The scan fits perfectly, 35 m from where it was taken: the same place is its own rival."""
    place_map = lone(network, between_walls(), 0.0)
    location = place_map.localize(between_walls(35.0))
    assert location.fit > 0.5
    assert math.hypot(location.x - 35.0, location.y) > 10
    assert location.doubt == "ratio"


def test_a_nearly_blank_place_is_no_reason_for_trust(network):
    """It fits nothing, so that any scan would be trusted for fitting better anywhere else."""
    far = np.tile(np.eye(4), (2, 1, 1))
    far[1, 0, 3] = 500.0
    place_map = Map(network)
    place_map.add([scattered(0), scattered(1)[:300]], far, ["seen", "heap"])
    assert LEAST_CELLS <= place_map.places.images(torch.tensor([1])).sum() < FEW_CELLS
    assert not any(place_map.localize(scattered(seed)).trusted for seed in range(2, 12))
    assert place_map.localize(scattered(0)).trusted


def test_a_few_cells_in_one_heap_are_not_trusted(network):
    """Two heaps fit each other wherever they are, and far better than they fit whole scenes."""
    place_map = Map(network)
    heap = [scattered(seed)[:300] for seed in (0, 1)]
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = 100.0 * np.arange(5)
    place_map.add([heap[0], *map(scattered, range(2, 6))], poses, list("abcde"))
    location = place_map.localize(heap[0] + np.float32([3, 0, 0]))
    assert location.name == "a"
    assert location.fit > 0.5
    assert location.cells < FEW_CELLS
    assert location.doubt == "few cells"


def test_real_scans_of_elsewhere_in_a_map_of_one_place(network):
    drive = open_kitti(real_data("kitti00_south"))
    place_map = lone(network, drive.points(0), -1.73)
    elsewhere = [drive.points(k) for k in range(100, len(drive), 60)]
    far = np.linalg.norm(drive.positions[100::60] - drive.positions[0], axis=1) > 60
    elsewhere = [points for points, away in zip(elsewhere, far, strict=True) if away]
    for folder, format in (("kitti08_pair", "kitti"), ("nclt_scans", "nclt")):
        elsewhere += [read_scan(path, format) for path in sorted(real_data(folder).iterdir())]
    assert len(elsewhere) > 10
    locations = [place_map.localize(points) for points in elsewhere]
    assert not any(location.trusted for location in locations)
    assert all(place_map.localize(drive.points(k)).trusted for k in (0, 1))
