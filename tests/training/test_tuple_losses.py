"""Losses of tuples and batches against sums by hand."""

import itertools

import pytest
import torch

from deepring.errors import DeepringError
from deepring.training.tuple_losses import (
    BatchHardTriplet,
    LazyQuadruplet,
    QuadrupletWithYaw,
    YawCrossEntropy,
)


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
    value = LazyQuadruplet(0.5, 0.2, positive)(vectors, 2)
    expected = quadruplet_by_hand(vectors, 2, 0.5, 0.2, positive == "nearest")
    assert float(value.loss) == pytest.approx(expected)
    # The usual misreading: distances instead of their squares.
    assert float(LazyQuadruplet(0.5, 0.2, positive)(vectors.sqrt(), 2).loss) != pytest.approx(
        expected
    )


def test_places_that_are_apart_cost_nothing():
    vectors = torch.tensor([[[0.0], [0.1], [0.2], [5.0], [6.0], [20.0]]])
    value = LazyQuadruplet()(vectors, 2)
    assert float(value.loss) == 0
    assert float(value.accuracy) == 1
    assert float(value.parts["active"]) == 0


def test_batch_hard_is_its_formula_over_what_is_not_zero():
    torch.manual_seed(1)
    places = torch.tensor([0, 0, 1, 1, 2, 2, 3])  # the last has no partner
    vectors = torch.rand(7, 4, dtype=torch.float64) + 0.6 * places[:, None]
    same = (places[:, None] == places[None]) & ~torch.eye(7, dtype=torch.bool)
    different = places[:, None] != places[None]
    value = BatchHardTriplet(0.2)(vectors, same, different)
    apart = torch.cdist(vectors, vectors)
    hinges = []
    for a in range(6):
        own = max(apart[a, p] for p in range(7) if same[a, p])
        wrong = min(apart[a, n] for n in range(7) if different[a, n])
        hinges.append(max(0.0, float(0.2 + own - wrong)))
    active = [h for h in hinges if h > 0]
    assert 0 < len(active) < 6
    assert float(value.loss) == pytest.approx(sum(active) / len(active), abs=1e-6)
    assert float(value.parts["active"]) == pytest.approx(len(active) / 6)


def test_all_triplets_are_the_mean_over_every_one_that_is_not_zero():
    torch.manual_seed(1)
    places = torch.tensor([0, 0, 0, 1, 1, 2])
    vectors = torch.rand(6, 4, dtype=torch.float64) + 0.3 * places[:, None]
    same = (places[:, None] == places[None]) & ~torch.eye(6, dtype=torch.bool)
    different = places[:, None] != places[None]
    apart = torch.cdist(vectors, vectors)
    hinges = [
        max(0.0, float(0.2 + apart[a, p] - apart[a, n]))
        for a, p, n in itertools.product(range(6), repeat=3)
        if same[a, p] and different[a, n]
    ]
    active = [h for h in hinges if h > 0]
    assert 0 < len(active) < len(hinges)
    value = BatchHardTriplet(0.2, "all")(vectors, same, different)
    assert float(value.loss) == pytest.approx(sum(active) / len(active), abs=1e-6)
    assert float(value.parts["active"]) == pytest.approx(len(active) / len(hinges))
    hardest = BatchHardTriplet(0.2)(vectors, same, different)
    assert float(hardest.loss) != pytest.approx(float(value.loss), abs=1e-3)
    assert float(hardest.accuracy) == float(value.accuracy)


def test_batch_hard_has_gradients_where_descriptors_coincide():
    vectors = torch.zeros(4, 3, requires_grad=True)
    pairs = torch.tensor([0, 0, 1, 1])
    same = (pairs[:, None] == pairs[None]) & ~torch.eye(4, dtype=torch.bool)
    loss = BatchHardTriplet()(vectors, same, pairs[:, None] != pairs[None]).loss
    loss.backward()
    assert torch.isfinite(vectors.grad).all()
    nothing = torch.zeros(4, 4, dtype=torch.bool)
    assert float(BatchHardTriplet()(vectors.detach(), nothing, nothing).loss) == 0


def test_the_yaw_loss_is_least_at_the_turn_and_nowhere_else():
    torch.manual_seed(2)
    maps = torch.rand(2, 3, 12, 6)
    turns = torch.tensor([4, 11])
    queries = torch.stack([m[0].roll(int(t), dims=0) for m, t in zip(maps, turns, strict=True)])
    positives = maps[:, :1].expand(-1, 3, -1, -1)
    loss = YawCrossEntropy(200.0).requires_grad_(False)
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
    value = QuadrupletWithYaw(yaw_scale=7.0).requires_grad_(False)(vectors, maps, 2, turn)
    first = LazyQuadruplet(positive="farthest")(vectors, 2).loss
    second = YawCrossEntropy(7.0).requires_grad_(False)(maps[:, 0], maps[:, 1:3], turn)
    assert float(value.loss) == pytest.approx(float(first + second))


def test_margins_that_are_none_are_refused():
    with pytest.raises(DeepringError, match=r"loss\.second_margin: 0"):
        LazyQuadruplet(second_margin=0)
    with pytest.raises(DeepringError, match=r"loss\.margin: -1"):
        BatchHardTriplet(-1)
    with pytest.raises(DeepringError, match=r"loss\.mining: 'some'"):
        BatchHardTriplet(mining="some")
    with pytest.raises(DeepringError, match=r"loss\.positive: 'both'"):
        LazyQuadruplet(positive="both")
