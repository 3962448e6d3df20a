"""Counting the best few places gives what the metrics of whole score matrices give."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.evaluation.counting import count, precision_recall
from deepring.evaluation.metrics import (
    BEHIND,
    first_right,
    first_right_among,
    max_f1,
    place_auc,
    place_precision_recall,
    recall_at_k,
)
from helpers.score_matrices import RADII, best_of, matrices


@settings(deadline=None)
@given(matrices())
def test_figures_are_those_of_the_whole_matrices_at_every_radius(made):
    matches, places = best_of(*made), made[0].shape[1]
    scores, distances = map(torch.from_numpy, made)
    answered = [r for r in RADII if (distances <= r).any()]
    for headline in answered:
        radii = [headline, *(r for r in RADII if r != headline)]
        results = count(matches, radii, places, 0.5, 0.25)
        assert [result.radius_m for result in results] == [r for r in radii if r in answered]
        for result in results:
            r = result.radius_m
            assert result.answerable == int((distances <= r).any(dim=1).sum())
            assert (result.database, result.queries) == (places, len(scores))
            assert result.recall_1 == float(recall_at_k(scores, distances, 1, r))
            assert result.recall_5 == float(recall_at_k(scores, distances, 5, r))
            assert result.f1_max == float(max_f1(scores, distances, r))
            assert result.auc == float(place_auc(scores, distances, r))
            assert (result.seconds_per_scan, result.seconds_per_query) == (0.5, 0.25)


@settings(deadline=None)
@given(matrices(), st.integers(1, 12))
def test_ranks_are_those_of_the_whole_matrices_as_far_as_places_are_kept(made, k):
    matches = best_of(*made, k)
    distance, nearest = map(torch.from_numpy, (matches.distance, matches.nearest))
    ranks = first_right_among(distance, nearest, RADII)
    for radius, found in zip(RADII, ranks, strict=True):
        whole = first_right(*map(torch.from_numpy, made), radius)[1]
        assert torch.equal(found, torch.where(whole > k, BEHIND, whole))


@settings(deadline=None)
@given(matrices(), st.integers(1, 3))
def test_the_curve_needs_the_best_place_alone(made, k):
    matches = best_of(*made, k)
    scores, distances = map(torch.from_numpy, made)
    if not (distances <= 10).any():
        with pytest.raises(DeepringError, match="radius 10 m: 0 of"):
            precision_recall(matches, 10.0)
        return
    expected = place_precision_recall(scores, distances, 10.0)
    for own, whole in zip(precision_recall(matches, 10.0), expected, strict=True):
        torch.testing.assert_close(own, whole, rtol=0, atol=0)


def test_an_unanswerable_query_costs_precision_and_no_recall():
    distances = np.array([[1, 40], [40, 40], [40, 2]], np.float32)
    matches = best_of(np.array([[3, 0], [2, 0], [1, 0]], np.float32), distances)
    precision, recall, _ = precision_recall(matches, 10.0)
    assert precision.tolist() == pytest.approx([1, 1 / 2, 1 / 3])
    assert recall.tolist() == pytest.approx([1 / 2, 1 / 2, 1])


def test_a_right_place_behind_the_best_ones_makes_a_query_answerable():
    distances = np.full((1, 7), 90, np.float32)
    distances[0, 5] = 3
    (result,) = count(best_of(-distances * 0, distances), [10.0], 7, 0, 0)
    assert (result.answerable, result.recall_1, result.recall_5) == (1, 0, 0)


def test_places_that_were_not_kept_count_for_no_recall():
    """A method that retrieves a single place has the same Recall@5 as Recall@1."""
    distances = np.array([[90, 3], [2, 90]], np.float32)
    matches = best_of(np.array([[1, 0], [1, 0]], np.float32), distances, 1)
    (result,) = count(matches, [10.0], 2, 0, 0)
    assert (result.answerable, result.recall_1, result.recall_5) == (2, 0.5, 0.5)


def test_radii_that_are_none_and_numbers_of_other_shapes_are_refused():
    with pytest.raises(DeepringError, match="radius: 0, expected a number of metres above 0"):
        first_right_among(torch.ones(2, 1), torch.ones(2), [0])
    for distances, nearest in (((2,), (2,)), ((2, 3), (3,)), ((2, 3), (2, 1))):
        with pytest.raises(DeepringError, match=r"expected \(queries, k\) and \(queries,\)"):
            first_right_among(torch.ones(distances), torch.ones(nearest), [10.0])


@settings(deadline=None, derandomize=True)
@given(matrices(), st.sampled_from([5.0, 10.0, 10.4]), st.sampled_from([10.5, 39.0, 40.0]))
def test_in_the_grey_zone_a_best_place_is_neither_right_nor_wrong(made, radius, beyond):
    """The loop over thresholds by which Locus and LoGG3D-Net count."""
    matches = best_of(*made)
    distance, score = matches.distance[:, 0], matches.score[:, 0]
    if not (matches.nearest <= radius).any():
        return
    points = []
    for threshold in sorted(set(score.tolist()), reverse=True):
        tp = fp = fn = 0
        for k in range(len(score)):
            if score[k] >= threshold:
                tp += distance[k] <= radius
                fp += distance[k] > beyond
            else:
                fn += matches.nearest[k] <= radius
        points.append((tp / max(tp + fp, 1), tp / max(tp + fn, 1), tp + fp))
    f1 = max(2 * p * r / (p + r) if p + r else 0.0 for p, r, _ in points)
    (result,) = count(matches, [radius], made[0].shape[1], 0, 0, beyond)
    assert result.f1_max == pytest.approx(f1, abs=1e-6)
    assert (result.radius_m, result.wrong_beyond_m) == (radius, beyond)
    counted = [(p, r) for p, r, n in points if n] or [(0.0, points[-1][1])]
    precision, recall, _ = precision_recall(matches, radius, beyond)
    np.testing.assert_allclose(np.transpose([precision, recall]), counted, atol=1e-6)
    steps = np.diff([0, *(r for _, r in counted)])
    assert result.ap == pytest.approx(sum(steps * [p for p, _ in counted]), abs=1e-5)


def test_a_grey_zone_raises_f1_where_near_misses_are_all_that_is_wrong():
    distances = np.array([[1], [8], [50]], np.float32)
    matches = best_of(np.array([[3], [2], [1]], np.float32), distances)
    (plain,) = count(matches, [3.0], 1, 0, 0)
    (grey,) = count(matches, [3.0], 1, 0, 0, 20.0)
    assert plain.recall_1 == grey.recall_1
    (at_all,) = (precision_recall(matches, 3.0, 20.0)[0][-1],)
    assert float(at_all) == pytest.approx(1 / 2), "not 1/3: 8 m counts for nothing"
    with pytest.raises(DeepringError, match="wrong_beyond: 2, expected at least the largest"):
        count(matches, [3.0], 1, 0, 0, 2.0)


def test_the_best_one_percent_of_the_places_count():
    places = 230  # 1 % are 2
    distances = np.full((3, places), 90, np.float32)
    for query, rank in enumerate((1, 2, 3)):
        distances[query, rank - 1] = 3
    matches = best_of(-np.tile(np.arange(places, dtype=np.float32), (3, 1)), distances)
    (result,) = count(matches, [10.0], places, 0, 0)
    assert (result.recall_1, result.recall_5) == (pytest.approx(1 / 3), 1)
    assert result.recall_1_percent == pytest.approx(2 / 3)


def test_average_precision_draws_no_line_between_thresholds():
    """All scores equal: the area under straight lines is half the square too much."""
    distances = np.array([[1], [90], [90], [1]], np.float32)
    matches = best_of(np.zeros((4, 1), np.float32), distances)
    (result,) = count(matches, [10.0], 1, 0, 0)
    assert result.ap == pytest.approx(0.5)
    falling = best_of(np.array([[4], [3], [2], [1]], np.float32), distances)
    (result,) = count(falling, [10.0], 1, 0, 0)
    assert result.ap == pytest.approx(0.5 * 1 + 0.5 * 0.5)
