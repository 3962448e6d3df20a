"""The shortlist against sorting all places by their keys."""

from typing import NamedTuple

import pytest
import torch

from deepring.errors import ConfigError, DataError
from deepring.search.shortlist import ShortlistIndex, key_distances, shortlisted


class Scored(NamedTuple):
    score: torch.Tensor
    turn: torch.Tensor | None


class Far:
    """Places are more alike the farther they are, so that the shortlist shows."""

    def compare(self, queries, database):
        score = torch.cdist(queries, database)
        return Scored(score, score / 100)


def keys(descriptors):
    """Two keys per place: its numbers, and their negatives."""
    return torch.stack([descriptors, -descriptors], dim=1)


def random(n, seed):
    return torch.randn(n, 3, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("candidates", [1, 4, 30, 99])
def test_the_best_of_the_candidates_against_sorting(candidates):
    queries, places = random(5, 0), random(30, 1)
    index = ShortlistIndex(Far(), keys, candidates)
    index.add(places[:11])
    index.add(places[11:])
    hits = index.search(queries, k=3)
    for q, query in enumerate(queries):
        near = [min((query - p).norm().item(), (query + p).norm().item()) for p in places]
        chosen = sorted(range(30), key=lambda d: near[d])[:candidates]
        expected = sorted(chosen, key=lambda d: -(query - places[d]).norm().item())[:3]
        assert hits.place[q].tolist() == expected
    assert torch.allclose(hits.turn, hits.score / 100)


def test_which_places_are_candidates():
    distance = torch.tensor([[3.0, 1.0, 2.0]])
    assert shortlisted(distance, 2).tolist() == [[False, True, True]]
    for every in (None, 3, 4):
        assert shortlisted(distance, every).all()


def test_the_nearest_key_of_a_place_counts_and_the_first_of_a_query():
    one = torch.tensor([[[0.0], [9.0]]])
    other = torch.tensor([[[5.0], [9.0]]])
    assert key_distances(one, other).tolist() == [[5]]
    assert key_distances(other, one).tolist() == [[4]]


def test_nothing_is_found_in_nothing_and_other_shapes_are_refused():
    index = ShortlistIndex(Far(), keys, 2)
    assert index.search(random(2, 0)).place.shape == (2, 0)
    index.add(random(4, 1))
    assert index.search(random(0, 0)).place.shape[0] == 0
    with pytest.raises(DataError, match="queries: 4 numbers, but the places are 3 numbers"):
        index.search(torch.zeros(1, 4))
    with pytest.raises(ConfigError, match="candidates: 0"):
        ShortlistIndex(Far(), keys, 0)
