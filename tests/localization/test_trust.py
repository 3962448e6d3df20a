"""A location is trusted for what was compared: without a rival, or with few cells, the fit alone
tells little."""

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
from deepring.localization.location import (
    CELLS_WITHOUT_RIVAL,
    FEW_CELLS,
    FIT_WITHOUT_RIVAL,
    AcceptanceThresholds,
)
from deepring.localization.loops import LOOP_THRESHOLDS
from deepring.localization.map import Map
from deepring.localization.observation import LEAST_CELLS
from deepring.methods.network_file import load_network
from helpers.real_data import real_data
from helpers.scenes import scattered

values = st.one_of(
    st.floats(-1, 2), st.sampled_from([0.0, 0.21, FIT_WITHOUT_RIVAL, 1.41, math.inf, math.nan])
)


@settings(derandomize=True, max_examples=300, deadline=None)
@given(
    fit=values,
    ratio=values,
    cells=st.sampled_from([0, FEW_CELLS - 1, FEW_CELLS, CELLS_WITHOUT_RIVAL, 9999]),
)
@example(fit=0.3, ratio=math.inf, cells=500)
@example(fit=0.3, ratio=math.nan, cells=500)
def test_a_location_is_trusted_or_has_one_doubt(fit, ratio, cells):
    for thresholds in (AcceptanceThresholds(), LOOP_THRESHOLDS, AcceptanceThresholds(0.0, 0.0)):
        expected = fit >= thresholds.fit and ratio >= thresholds.ratio and cells >= FEW_CELLS
        if ratio == math.inf and thresholds.ratio > 0:
            expected = expected and fit >= FIT_WITHOUT_RIVAL and cells >= CELLS_WITHOUT_RIVAL
        assert bool(thresholds.accept(fit, ratio, cells)) == expected
        assert (thresholds.doubt(fit, ratio, cells) is None) == expected
        several = thresholds.accept(*(np.array([value, value]) for value in (fit, ratio, cells)))
        assert several.tolist() == [expected, expected]


def test_what_is_doubted_is_named():
    usual = AcceptanceThresholds()
    assert usual.doubt(0.1, 9.0, 500) == usual.doubt(0.1, math.inf, 500) == "fit"
    assert usual.doubt(0.3, 1.2, 500) == usual.doubt(0.3, math.nan, 500) == "ratio"
    assert usual.doubt(0.3, math.inf, 500) == "no rival"
    assert usual.doubt(0.9, 9.0, FEW_CELLS - 1) == "few cells"
    assert usual.doubt(0.9, math.inf, CELLS_WITHOUT_RIVAL - 1) == "no rival"
    assert usual.doubt(math.nan, 9.0, 500) == "fit"
    # A stricter map asks no less where there is no rival; loops ask the same.
    assert AcceptanceThresholds(fit=0.5).doubt(0.45, math.inf, 500) == "fit"
    assert LOOP_THRESHOLDS.fit_without_rival == usual.fit_without_rival == FIT_WITHOUT_RIVAL


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
def test_scans_of_elsewhere_are_not_trusted_where_nothing_is_compared(network, places):
    place_map = lone(network, scattered(0), 0.0, places)
    for seed in range(1, 12):
        location = place_map.localize(scattered(seed))
        assert location.ratio == math.inf
        assert not location.trusted
        assert location.doubt in ("fit", "no rival")
    # The old rule trusted them: this fit is enough where a rival fits much worse.
    best = max(place_map.localize(scattered(seed)).fit for seed in range(1, 12))
    assert AcceptanceThresholds(fit=best).accept(best, 2.0, 500)


def test_the_place_itself_is_trusted_without_a_rival(network, tiny_nclt):
    first, second = (open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17"))
    place_map = lone(network, first.points(10), 0.0)
    assert place_map.localize(first.points(10)).trusted
    near = np.linalg.norm(second.positions - first.positions[10], axis=1).argmin()
    location = place_map.localize(second.points(int(near)))
    assert location.ratio == math.inf
    assert location.trusted
    assert location.doubt is None


def test_a_rival_that_fits_not_at_all_is_none(network):
    """Of a place without any occupied cell the fit is 0: nothing was compared."""
    place_map = Map(network)
    observation = place_map.observe([scattered(0)])
    place_map.add_observation(observation, np.eye(4)[None], ["seen"])
    far = np.eye(4)
    far[0, 3] = 500.0
    # As in maps of earlier versions; now such a scan is refused.
    place_map.places.add(np.zeros_like(observation.images), far[None], ["blank"])
    place_map.index.add(observation.descriptors)
    location = place_map.localize(scattered(0))
    assert location.name == "seen"
    assert location.ratio == math.inf
    assert place_map.localize(scattered(1)).doubt in ("fit", "no rival")


def test_a_nearly_blank_place_is_no_rival(network):
    """It fits nothing, so that any scan would be trusted for fitting better anywhere else."""
    far = np.tile(np.eye(4), (2, 1, 1))
    far[1, 0, 3] = 500.0
    place_map = Map(network)
    place_map.add([scattered(0), scattered(1)[:300]], far, ["seen", "heap"])
    assert LEAST_CELLS <= place_map.places.images(torch.tensor([1])).sum() < FEW_CELLS
    for seed in range(2, 12):
        location = place_map.localize(scattered(seed))
        assert location.doubt in ("fit", "no rival", "few cells")
    assert place_map.localize(scattered(0)).trusted
    usual = Map(network)
    usual.add([scattered(0), scattered(1)], far, ["seen", "other"])
    assert math.isfinite(usual.localize(scattered(0)).ratio)


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
    assert {location.doubt for location in locations} <= {"fit", "no rival"}
    assert all(place_map.localize(drive.points(k)).trusted for k in (0, 1))
