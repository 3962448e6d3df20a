"""Recall@N over N is that of whole score matrices, and changes nothing of the other figures."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.counting import count
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.metrics import recall_at_k
from deepring.evaluation.recall_curves import (
    COLUMNS,
    FILE,
    MOST,
    RecallCurve,
    read_recall_curves,
    recall_curves,
    write_recall_curves,
)
from helpers.score_matrices import RADII, best_of, matrices

CASE = Case("Ring, turned", "a+b", "sim", "test")


def by_hand(scores, distances, n, radius):
    """Of the queries with a place within the radius, the share with one among the best n."""
    hits, answerable = 0, 0
    for score, distance in zip(scores, distances, strict=True):
        order = sorted(range(len(score)), key=lambda place: (-score[place], place))
        answerable += any(distance <= radius)
        hits += any(distance[place] <= radius for place in order[:n])
    return hits / answerable


@settings(deadline=None)
@given(matrices(40))
def test_each_recall_is_that_of_the_whole_matrices(made):
    scores, distances = made
    radii = [radius for radius in RADII if (distances <= radius).any()]
    curves = recall_curves(best_of(scores, distances, MOST), RADII)
    assert [curve.radius_m for curve in curves] == radii  # none where no query has an answer
    for curve in curves:
        assert len(curve.recalls) == min(MOST, scores.shape[1])
        for n, recall in enumerate(curve.recalls, 1):
            whole = recall_at_k(*map(torch.from_numpy, made), n, curve.radius_m)
            assert recall == float(whole)
            assert recall == pytest.approx(by_hand(scores, distances, n, curve.radius_m))


@settings(deadline=None)
@given(matrices(40))
def test_keeping_more_places_changes_no_published_figure(made):
    radii = [radius for radius in RADII if (made[1] <= radius).any()]
    few, many = (best_of(*made, k) for k in (5, MOST))
    if not radii:
        return
    counted = [count(each, radii, made[0].shape[1], 0.5, 0.25) for each in (few, many)]
    assert counted[0] == counted[1]
    for result, curve in zip(counted[1], recall_curves(many, radii), strict=True):
        assert result.recall_1 == curve.recalls[0] == result.recall_1_percent
        assert result.recall_5 == curve.recalls[min(5, len(curve.recalls)) - 1]


def test_counter_example_it_is_no_share_of_the_right_places():
    distance = np.float32([[50, 1, 2, 50, 3]])
    matches = TopMatches(
        *(CASE, np.array([7]), np.arange(5)[None], -np.arange(5, dtype=np.float32)[None]),
        *(None, distance, distance.min(axis=1)),
    )
    (curve,) = recall_curves(matches, [10.0])
    assert curve.recalls == (0, 1, 1, 1, 1)  # and not 0, 1/3, 2/3, 2/3, 1


def curve(*recalls, radius=10.0):
    return RecallCurve(CASE, radius, recalls)


def test_the_round_trip_is_exact_and_a_run_without_the_file_has_none(tmp_path):
    third = float(np.float32(1 / 3))
    curves = [curve(*[third] * MOST), curve(0.1, third, radius=5.0)]
    assert read_recall_curves(tmp_path) == []
    write_recall_curves(tmp_path / "run", curves)
    assert read_recall_curves(tmp_path / "run") == curves
    assert [path.name for path in (tmp_path / "run").iterdir()] == [FILE]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (["0.5", "0.4"], "do not fall"),
        (["0.5", "", "0.6"], "0.5,,0.6"),
        (["1.5"], "recall_1"),
        (["half"], "half"),
        ([], "1 to 25 numbers"),
        (["0.1"] * 26, "31 values, expected 30"),
    ],
)
def test_what_cannot_be_right_is_refused_with_its_line(tmp_path, row, message):
    cells = [*CASE.columns.values(), "10.0", *row]
    cells += [""] * (len(COLUMNS) - len(cells))
    quoted = ",".join(f'"{cell}"' for cell in cells)
    (tmp_path / FILE).write_text(f"{','.join(COLUMNS)}\n{quoted}\n", encoding="utf-8")
    with pytest.raises(DeepringError, match=rf"recalls\.csv, line 2: .*{message}"):
        read_recall_curves(tmp_path)


def test_another_file_is_refused(tmp_path):
    (tmp_path / FILE).write_text("method,recall\n")
    with pytest.raises(DeepringError, match=r"recalls\.csv, line 1: expected 'method,train"):
        read_recall_curves(tmp_path)
    (tmp_path / FILE).write_bytes(b"\xff\xfe")
    with pytest.raises(DeepringError, match="is not UTF-8"):
        read_recall_curves(tmp_path)
