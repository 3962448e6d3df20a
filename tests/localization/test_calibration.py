"""Thresholds of trust: the most right locations at a precision, by brute force and by example."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import pose_from, rotation_from_rpy, turn_points
from deepring.data.readers.nclt import open_nclt
from deepring.errors import DeepringError
from deepring.localization.calibration import (
    FITS,
    LocalizationTrials,
    Tolerance,
    calibrate,
    concatenate,
    evaluate_thresholds,
    run_trials,
)
from deepring.localization.candidates import RerankSettings
from deepring.localization.location import (
    FEW_CELLS,
    FIT_TIMES_ROOT_OF_CELLS,
    AcceptanceThresholds,
)
from deepring.localization.map_building import build_map
from helpers.networks import small_network


def trials(fit, ratio, right, nearest=0.0):
    right = np.asarray(right)
    return LocalizationTrials(
        np.asarray(fit, float),
        np.asarray(ratio, float),
        np.where(right, 0.5, 30.0),
        np.zeros(len(right)),
        np.broadcast_to(np.asarray(nearest, float), len(right)),
        np.full(len(right), 500.0),
    )


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    precision=st.sampled_from([0.5, 0.8, 0.95]),
    cells=st.sampled_from([50, 150, 500]),
)
def test_no_thresholds_trust_more_right_ones_at_this_precision(seed, precision, cells):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 60))
    # Few different ratios: equal ones have to be taken together. Some show little.
    some = trials(rng.uniform(0, 0.6, n), rng.integers(1, 8, n) / 2, rng.random(n) < 0.8)
    some.cells[: n // 2] = cells
    right = some.correct(Tolerance())
    tell = (some.cells >= FEW_CELLS) & (some.fit * some.cells**0.5 >= FIT_TIMES_ROOT_OF_CELLS)
    most = 0
    for fit in FITS:
        for ratio in np.unique(some.ratio):
            chosen = tell & (some.fit >= fit) & (some.ratio >= ratio)
            good = int((chosen & right).sum())
            if good >= precision * (chosen.sum() + 1):
                most = max(most, good)
    if most == 0:
        with pytest.raises(DeepringError, match="reached by no thresholds"):
            calibrate(some, precision)
        return
    found = calibrate(some, precision)
    chosen = some.trusted(found.thresholds)
    assert int((chosen & right).sum()) == most
    assert found.trusted == chosen.sum()
    assert found.precision == most / chosen.sum() >= precision


def test_a_few_right_ones_do_not_make_a_high_precision():
    with pytest.raises(DeepringError, match=r"at most a precision of 0\.989; take more scans"):
        calibrate(trials([0.5] * 90, [2.0] * 90, [True] * 90), 0.99)
    assert calibrate(trials([0.5] * 99, [2.0] * 99, [True] * 99), 0.99).precision == 1.0


def test_right_means_both_position_and_heading():
    some = LocalizationTrials(
        *np.array([[0.5] * 3, [2.0] * 3, [1.9, 2.1, 1.9], [4.9, 0, 5.1], [0, 0, 0.0], [500] * 3])
    )
    assert some.correct(Tolerance()).tolist() == [True, False, False]
    assert some.correct(Tolerance(metres=3)).tolist() == [True, True, False]


def test_recall_counts_the_scans_near_the_map_alone():
    some = trials([0.5, 0.5, 0.1, 0.5], [2, 2, 2, 2], [True, True, True, False], [0, 5, 5, 90])
    found = evaluate_thresholds(some, AcceptanceThresholds(0.2, 1.5))
    assert found.precision == pytest.approx(2 / 3)
    assert found.recall == pytest.approx(2 / 3)


def test_a_threshold_is_a_number():
    """A map file holds no infinite one, and NaN is no ratio."""
    with pytest.raises(DeepringError, match="reached by no thresholds"):
        calibrate(trials([0.5] * 200, [math.inf] * 200, [True] * 200), 0.9)
    with pytest.raises(DeepringError, match="0 of 0 scans"):
        calibrate(trials([], [], []), 0.9)
    with pytest.raises(DeepringError, match="reached by no thresholds"):
        calibrate(trials([0.5] * 9, [math.nan] * 9, [True] * 9), 0.5)
    some = trials([0.5] * 200, [math.inf] * 100 + [2.0] * 100, [True] * 200)
    assert calibrate(some, 0.9).thresholds.ratio == 2.0


@pytest.mark.parametrize("precision", [0.0, 1.0, -1, math.nan])
def test_a_precision_is_a_share(precision):
    with pytest.raises(DeepringError, match="precision"):
        calibrate(trials([0.5], [2], [True]), precision)


def test_trials_of_a_drive_and_its_own_map(tiny_nclt):
    first, second = (open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17"))
    # The network is not trained: what it takes for alike is little better than chance.
    place_map = build_map(first, small_network(), 5.0, rerank=RerankSettings(candidates=100))
    scans = [(second.points(k), second.poses[k]) for k in range(0, len(second), 8)]
    whole = run_trials(place_map, scans)
    parts = concatenate([run_trials(place_map, scans[:2]), run_trials(place_map, scans[2:])])
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)
    assert whole.correct(Tolerance()).all()
    assert (whole.nearest < 10).all()
    # Points that are turned by +turn are those of a sensor that looks -turn away.
    for sign, right in ((-1, True), (1, False)):
        turn = pose_from(rotation_from_rpy(0, 0, sign * 0.5), np.zeros(3))
        moved = [(turn_points(p, 0.5), pose @ turn) for p, pose in scans[:3]]
        assert run_trials(place_map, moved).correct(Tolerance()).all() == right
