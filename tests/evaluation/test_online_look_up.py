"""Online look-up finds what a comparison with the old enough places alone puts first."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from deepring.data.dataset import RetrievalSet
from deepring.errors import DeepringError
from deepring.evaluation.descriptors import read_descriptors, write_descriptors
from deepring.evaluation.distances import nearest_distances
from deepring.evaluation.online import look_up_among
from deepring.evaluation.protocol import evaluate_method
from deepring.evaluation.reranked import evaluate_reranked
from deepring.evaluation.scoring import find_pairs, score_pair
from deepring.evaluation.task import RetrievalTask, rows_of
from deepring.localization.candidates import RerankSettings
from deepring.methods.method import describe_all
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.rasters import BevRaster
from helpers.drives import QUERIES, road_task
from helpers.tiny_methods import BEV, CONTEXT, TINY, deepring

METHODS = {
    **TINY,
    "RING, published": lambda: Ring(BEV, angles=24, bins=24, correlation="published"),
    "Scan Context, 3 candidates": lambda: ScanContext(CONTEXT, candidates=3),
    "DeepRING by cosine": lambda: deepring(aggregation="gap", similarity="cosine"),
}

#: The last place is 3 keyframes old at least.
EARLIER = 3


def online_task(raster, **kwargs):
    """Each scan of a drive as a query among the scans before the last few ones."""
    task = road_task(raster, **kwargs)
    scans = task.scans.query
    every = np.arange(len(scans))
    query = scans.subset(every >= EARLIER)
    split = RetrievalSet("road", "test", scans, query, query.indices - EARLIER + 1)
    return RetrievalTask(split, task.query, task.query.__class__(
        task.query.data[EARLIER:], raster
    ))  # fmt: skip


@pytest.mark.parametrize("label", METHODS)
def test_each_query_is_compared_with_the_places_that_it_may_find_and_no_others(label):
    method = METHODS[label]()
    task = online_task(method.raster)
    places, queries = (describe_all(method, side) for side in (task.database, task.query))
    searched = task.scans.searched
    hits, seconds = look_up_among(method, places.split(7), queries.split(5), 4, searched)
    assert seconds > 0
    assert hits.place.shape == hits.score.shape == (QUERIES - EARLIER, min(4, hits.place.shape[1]))
    for q, number in enumerate(searched.tolist()):
        alone = method.compare(queries[q : q + 1], places[:number])
        best = alone.score[0].argsort(descending=True, stable=True)[: hits.place.shape[1]]
        found = hits.place[q, : len(best)]
        scores = alone.score[0]
        # Equal scores may rank otherwise by rounding: what is compared is the scores.
        torch.testing.assert_close(scores[found], scores[best], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(hits.score[q, : len(best)], scores[best], rtol=1e-4, atol=1e-5)
        assert len(set(found.tolist())) == len(best)
        assert (hits.place[q, len(best) :] == found[-1]).all(), "the last one is repeated"
        assert int(hits.place[q].max()) < number


def test_filtering_afterwards_would_not_do():
    """The nearest by key among all places are mostly too recent."""
    method = METHODS["Scan Context, 3 candidates"]()
    task = online_task(method.raster)
    places, queries = (describe_all(method, side) for side in (task.database, task.query))
    searched = task.scans.searched
    every = look_up_among(method, [places], [queries], 3, None)[0]
    lost = (every.place >= torch.from_numpy(searched)[:, None]).all(dim=1)
    assert int(lost.sum()) > 3


def test_figures_are_counted_with_what_was_compared(tmp_path):
    method = METHODS["ring"]()
    task = online_task(method.raster)
    outcome = evaluate_method(task.case("RING"), method, task, (10.0, 30.0), export=tmp_path)
    positions = task.scans.database.positions[:, 0]
    right = answerable = 0
    for q, number in enumerate(task.scans.searched.tolist()):
        away = np.abs(positions[:number] - task.scans.query.positions[q, 0])
        assert outcome.matches.nearest[q] == pytest.approx(away.min(), abs=1e-3)
        answerable += away.min() <= 10
        right += outcome.matches.distance[q, 0] <= 10
    row = outcome.results[0]
    assert (row.answerable, row.queries, row.database) == (answerable, QUERIES - EARLIER, QUERIES)
    assert row.recall_1 == pytest.approx(right / answerable)
    assert 0 < row.recall_1 < 1

    (pair,) = find_pairs(tmp_path)
    rescored = score_pair(pair, (10.0, 30.0))
    assert [replace(r, seconds_per_query=0) for r in rescored.results] == [
        replace(r, seconds_per_query=0) for r in outcome.results
    ]
    assert np.array_equal(rescored.matches.place, outcome.matches.place)
    query = read_descriptors(pair.query)
    assert read_descriptors(pair.database).before is None
    for before in (query.before - 3, query.before[::-1].copy(), query.before + 5):
        write_descriptors(pair.query, replace(query, before=before))
        with pytest.raises(DeepringError, match="before: not that of an online evaluation"):
            score_pair(pair)


def test_one_percent_is_of_the_places_that_each_query_may_find():
    method = METHODS["ring"]()
    outcome = evaluate_method(
        (task := online_task(method.raster)).case("RING"), method, task, (10.0,)
    )
    assert outcome.results[0].recall_1_percent == outcome.results[0].recall_1


@pytest.mark.parametrize("candidates", [3, 25])
def test_aligned_candidates_and_locations_are_old_enough(candidates):
    method = Ring(BevRaster(), angles=24, bins=24)
    task = online_task(method.raster, away=3.0)
    short = np.arange(len(task.query)) < 9  # among 1 to 9 places
    scans = task.scans.among(task.scans.database, task.scans.query.subset(short))
    task = RetrievalTask(scans, task.database, task.query.__class__(
        task.query.data[:9], method.raster
    ))  # fmt: skip
    settings = RerankSettings(candidates=candidates)
    radii = (40.0,)
    alone = evaluate_method(task.case("RING"), method, task, radii, best=candidates)
    for outcome in evaluate_reranked(alone, task, ["pose", "locate"], settings):
        rows = rows_of(task.scans.database, outcome.matches.place)
        assert (rows < task.scans.searched[:, None]).all()
        firsts = [len(set(row[: task.scans.searched[q]])) for q, row in enumerate(rows)]
        assert firsts == [min(n, rows.shape[1]) for n in task.scans.searched], "none is repeated"


def test_numbers_that_fall_are_refused():
    method = METHODS["ring"]()
    places = torch.rand(4, 24, 13)
    for searched in ([0, 1], [2, 1]):
        with pytest.raises(DeepringError, match="searched: numbers of places that fall or are"):
            look_up_among(method, [places], [places[:2]], 1, np.array(searched))


def test_distances_to_places_that_are_too_recent_do_not_count():
    task = online_task(BEV)
    searched = task.scans.searched
    every = nearest_distances(task.scans.query, task.scans.database)
    assert (every == 0).all(), "each query is a place itself"
    assert (nearest_distances(task.scans.query, task.scans.database, searched, 7) > 0).any()
