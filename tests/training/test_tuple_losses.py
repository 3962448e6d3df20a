"""Losses of tuples against sums by hand."""

import itertools

import pytest
import torch

from deepring.errors import DeepringError
from deepring.training.tuples import (
    LazyQuadruplet,
    QuadrupletWithTurn,
    TupleDescriptors,
    TurnCrossEntropy,
)


def tuples(vectors, positives, maps=None, turn=None):
    turn = torch.zeros(len(vectors), dtype=torch.int64) if turn is None else turn
    return TupleDescriptors(vectors, vectors if maps is None else maps, positives, turn)


def quadruplet_by_hand(vectors, positives, m1, m2, nearest):
    total = 0.0
    for query, *rest in vectors.tolist():
        own, negatives, other = rest[:positives], rest[positives:-1], rest[-1]

        def d(a, b):
            return sum((x - y) ** 2 for x, y in zip(a, b, strict=True))

        near = (min if nearest else max)(d(query, p) for p in own)
        total += max(max(0.0, m1 + near - d(query, n)) for n in negatives)
        total += max(max(0.0, m2 + near - d(n, other)) for n in negatives)
    return total / len(vectors)


@pytest.mark.parametrize("positive", ["nearest", "farthest"])
def test_the_lazy_quadruplet_is_its_formula(positive):
    torch.manual_seed(0)
    vectors = torch.rand(3, 1 + 2 + 4 + 1, 5, dtype=torch.float64)
    value = LazyQuadruplet(0.5, 0.2, positive)(tuples(vectors, 2))
    expected = quadruplet_by_hand(vectors, 2, 0.5, 0.2, positive == "nearest")
    assert float(value.loss) == pytest.approx(expected)
    # The usual misreading: distances instead of their squares.
    assert float(
        LazyQuadruplet(0.5, 0.2, positive)(tuples(vectors.sqrt(), 2)).loss
    ) != pytest.approx(expected)


def test_places_that_are_apart_cost_nothing():
    vectors = torch.tensor([[[0.0], [0.1], [0.2], [5.0], [6.0], [20.0]]])
    value = LazyQuadruplet()(tuples(vectors, 2))
    assert float(value.loss) == 0
    assert float(value.accuracy) == 1
    assert float(value.parts["active"]) == 0


def test_the_loss_of_the_turn_is_least_at_the_turn_and_nowhere_else():
    torch.manual_seed(2)
    maps = torch.rand(2, 3, 12, 6)
    turns = torch.tensor([4, 11])
    queries = torch.stack([m[0].roll(int(t), dims=0) for m, t in zip(maps, turns, strict=True)])
    positives = maps[:, :1].expand(-1, 3, -1, -1)
    loss = TurnCrossEntropy(200.0).requires_grad_(False)
    found = {
        pair: float(loss(queries, positives, torch.tensor(pair)))
        for pair in itertools.product(range(12), repeat=2)
    }
    assert min(found, key=found.get) == (4, 11)
    # The usual misreading: turned the other way.
    assert found[8, 1] > found[4, 11] + 1


def test_discos_loss_is_the_sum_of_both():
    torch.manual_seed(3)
    vectors, maps = torch.rand(2, 6, 5), torch.rand(2, 6, 12, 4)
    turn = torch.tensor([3, 0])
    value = QuadrupletWithTurn(turn_scale=7.0).requires_grad_(False)(tuples(vectors, 2, maps, turn))
    first = LazyQuadruplet(positive="farthest")(tuples(vectors, 2)).loss
    second = TurnCrossEntropy(7.0).requires_grad_(False)(maps[:, 0], maps[:, 1:3], turn)
    assert float(value.loss) == pytest.approx(float(first + second))


def test_margins_that_are_none_are_refused():
    with pytest.raises(DeepringError, match=r"loss\.second_margin: 0"):
        LazyQuadruplet(second_margin=0)
    with pytest.raises(DeepringError, match=r"loss\.positive: 'both'"):
        LazyQuadruplet(positive="both")
