"""Re-ranked matches: an order of the candidates, or of all places, that alignment gives."""

import numpy as np
import pytest
import torch

from deepring.evaluation.counting import count
from deepring.evaluation.protocol import evaluate_method
from deepring.evaluation.reranked import evaluate_reranked, planar_poses
from deepring.evaluation.task import rows_of
from deepring.localization.candidates import RerankSettings, align_candidates, by_pose
from deepring.localization.location import best_fit
from deepring.methods.ring import Ring
from deepring.rasters import BevRaster
from helpers.drives import PLACES, QUERIES, road_task

SETTINGS = RerankSettings(candidates=3)


@pytest.fixture(scope="module")
def made():
    """A task, RING's outcome on it, and those of both modes."""
    method = Ring(BevRaster(), angles=24, bins=24)
    task = road_task(method.raster, turned=True, away=3.0)
    alone = evaluate_method(task.case("RING"), method, task, best=6)
    told = []
    modes = ("pose", "locate")
    both = evaluate_reranked(alone, task, modes, SETTINGS, lambda *n: told.append(n))
    assert told[-1] == (QUERIES, QUERIES)
    return task, alone, dict(zip(modes, both, strict=True))


def aligned(task, alone, q):
    """The candidates of query ``q``, and their alignment made once more."""
    place = torch.from_numpy(alone.matches.place[q, : SETTINGS.candidates])
    turn = torch.from_numpy(alone.matches.turn[q, : SETTINGS.candidates])
    maps = task.database[place.numpy()]
    return place, align_candidates(task.query[q : q + 1][0], turn, maps, SETTINGS)


def test_by_pose_the_candidates_are_put_in_another_order(made):
    task, alone, modes = made
    ours, theirs = modes["pose"].matches, alone.matches
    assert ours.place.shape == theirs.place.shape
    ordered, before = (m.place[:, : SETTINGS.candidates] for m in (ours, theirs))
    assert np.array_equal(np.sort(ordered), np.sort(before))
    assert not np.array_equal(ordered, before)
    others, others_before = (m.place[:, SETTINGS.candidates :] for m in (ours, theirs))
    assert np.array_equal(others, others_before), "behind them, the rest as it was"
    for q in range(0, QUERIES, 9):
        places, alignment = aligned(task, alone, q)
        order = by_pose(alignment, SETTINGS)
        assert ordered[q].tolist() == places[order].tolist()
        assert ours.score[q, 0] == pytest.approx(float(alignment.score[order[0]]))


def test_by_location_all_places_are_ranked_by_their_distance_to_the_position(made):
    task, alone, modes = made
    ours, database = modes["locate"].matches, task.scans.database
    assert ours.place.shape == (QUERIES, PLACES)  # of more than 25 the nearest
    poses = planar_poses(database)
    for q in range(0, QUERIES, 9):
        places, alignment = aligned(task, alone, q)
        best = best_fit(alignment, poses[places], SETTINGS)
        away = np.linalg.norm(database.positions - best.position.numpy(), axis=1)
        assert ours.place[q].tolist() == np.argsort(away, kind="stable").tolist()
        assert ours.score[q, 0] == pytest.approx(best.fit)


def test_distances_are_those_of_the_places_in_their_new_order(made):
    task, _, modes = made
    query, database = task.scans.query, task.scans.database
    for outcome in modes.values():
        matches = outcome.matches
        rows = rows_of(database, matches.place)
        away = query.positions[:, None] - database.positions[rows]
        np.testing.assert_allclose(matches.distance, np.linalg.norm(away, axis=2), rtol=1e-6)
        assert np.array_equal(matches.query, query.indices)
        assert matches.turn is None


def test_figures_are_counted_as_any_others_and_say_what_they_are_of(made):
    task, alone, modes = made
    first = alone.results[0]
    names = {"pose": "RING + pose re-ranking", "locate": "RING + map poses (localisation)"}
    for mode, outcome in modes.items():
        assert outcome.case == task.case(names[mode])
        seconds = outcome.results[0].seconds_per_query
        assert seconds > first.seconds_per_query
        radii = [result.radius_m for result in alone.results]
        again = count(outcome.matches, radii, PLACES, first.seconds_per_scan, seconds)
        assert outcome.results == again
        assert [r.answerable for r in again] == [r.answerable for r in alone.results]


def test_with_one_candidate_pose_re_ranking_retrieves_what_the_method_does(made):
    task, alone, _ = made
    (outcome,) = evaluate_reranked(alone, task, ["pose"], RerankSettings(candidates=1))
    assert np.array_equal(outcome.matches.place, alone.matches.place)
    assert outcome.results[0].recall_1 == alone.results[0].recall_1
    assert outcome.results[0].recall_5 == alone.results[0].recall_5
