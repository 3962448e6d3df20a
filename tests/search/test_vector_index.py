"""Nearest vectors against brute force in double precision, however close they lie."""

import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import ConfigError, DataError
from deepring.search import vector_index
from deepring.search.vector_index import SPARE, VectorIndex


def vectors(n, width=16, seed=0):
    return torch.randn(n, width, generator=torch.Generator().manual_seed(seed))


def index_of(database, metric="l2", lots=3, **arguments):
    index = VectorIndex(metric, **arguments)
    for lot in database.chunk(lots):
        index.add(lot)
    return index


def brute_force(queries, database, metric):
    """Scores (q, n) in double precision."""
    q, d = queries.double(), database.double()
    if metric == "cosine":
        return F.normalize(q, dim=1) @ F.normalize(d, dim=1).T
    return -torch.linalg.vector_norm(q[:, None] - d, dim=-1)


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(["l2", "cosine"]),
    st.integers(1, 12),
    st.integers(1, 120),
    st.integers(1, 40),
    st.integers(1, 50),
)
def test_it_is_brute_force(metric, q, n, width, k):
    queries, database = vectors(q, width, 1), vectors(n, width, 2)
    hits = index_of(database, metric).search(queries, k)
    exact = brute_force(queries, database, metric)
    assert hits.place.shape == (q, min(k, n))
    assert torch.allclose(hits.score.double(), exact.topk(min(k, n)).values, atol=1e-5)
    assert torch.allclose(hits.score.double(), exact.gather(1, hits.place), atol=1e-5)
    assert hits.turn is None


@pytest.mark.parametrize("q", [1, 40])
@pytest.mark.parametrize("metric", ["l2", "cosine"])
def test_places_in_many_chunks_are_searched_as_in_one(metric, q, monkeypatch):
    database, queries = vectors(500), vectors(q, seed=1)
    whole = index_of(database, metric).search(queries, 5)
    for name in ("_CHUNK", "_CHUNK_OF_FEW", "_CHUNK_OF_DIFFERENCES"):
        monkeypatch.setattr(vector_index, name, 7)
    parts = index_of(database, metric).search(queries, 5)
    assert torch.equal(parts.place, whole.place)
    assert torch.equal(whole.place, brute_force(queries, database, metric).topk(5).indices)


@pytest.mark.parametrize("q", [1, 40])
def test_neighbours_are_told_apart_where_products_cannot(q):
    # 1e-5 apart at a norm of 10: products are off by more than all distances there are.
    centre = 10 * F.normalize(vectors(1, 64), dim=1)
    database = centre + 1e-5 * torch.arange(400)[:, None] * torch.eye(64)[:1]
    queries = database[100 : 100 + q]
    hits = index_of(database).search(queries)
    assert hits.place[:, 0].tolist() == list(range(100, 100 + q))
    assert hits.score.abs().max() == 0
    ranks = queries @ database.T - database.square().sum(dim=1) / 2
    candidates = ranks.topk(SPARE + 1).indices
    missed = (candidates != torch.arange(100, 100 + q)[:, None]).all(dim=1)
    assert missed.any()  # or nothing would have been asked of the second look


def test_all_places_are_compared_only_where_rounding_may_mislead(monkeypatch):
    asked = []
    compare_all = VectorIndex._by_differences

    def counted(self, queries, k):
        asked.append(len(queries))
        return compare_all(self, queries, k)

    monkeypatch.setattr(VectorIndex, "_by_differences", counted)
    apart, close = vectors(200, 64), 1e-6 * vectors(100, 64, 1) + vectors(1, 64, 2)
    index = index_of(torch.cat([apart, close]))
    index.search(apart[:20])
    assert asked == []
    index.search(torch.cat([apart[:20], close[:2]]))
    assert asked == [2]


def test_of_equal_places_the_first_are_named():
    database = vectors(1).expand(300, -1)
    assert index_of(database).search(database[:1], 3).place.tolist() == [[0, 1, 2]]


def test_turns_are_of_the_hits_alone():
    database = vectors(50)

    def align(query, places):
        return query[0] - places[:, 0]

    hits = index_of(database, align=align).search(database[:3] + 0.5, 4)
    assert torch.allclose(hits.turn, database[:3, :1] + 0.5 - database[hits.place, 0])


def test_empty_lots_queries_and_places():
    index = VectorIndex("l2")
    assert index.search(vectors(2, 3)).place.shape == (2, 0)
    index.add(vectors(0, 3))
    assert len(index) == 0
    index.add(vectors(4, 3))
    assert index.search(vectors(0, 3), 2).place.shape[0] == 0


def test_mistakes_are_named():
    index = index_of(vectors(4, 3), "cosine")
    with pytest.raises(DataError, match="5 numbers, but the places are 3 numbers"):
        index.search(vectors(1, 5))
    with pytest.raises(ConfigError, match="metric: 'dot', expected one of l2, cosine"):
        VectorIndex("dot")
    with pytest.raises(ConfigError, match="k: 0"):
        index.search(vectors(1, 3), 0)
