"""Losses of an episode, each against loops over its triplets and quadruplets."""

import math

import pytest
import torch
import torch.nn.functional as F

from deepring.core.correlation import circular_cross_correlation, unit_norm
from deepring.core.similarity import cosine, negative_distance
from deepring.errors import DeepringError
from deepring.training.episodes import OneShotCrossEntropy, Quadruplet, Triplet, class_scores

WAYS, QUERIES = 4, 2


def correlation(queries, database):
    return circular_cross_correlation(queries, database).score


def episode(shots=1, seed=0, noise=1.0):
    """Descriptors of queries (8, 6, 5), support (4, shots, 6, 5), and the queries' ways."""
    generator = torch.Generator().manual_seed(seed)
    centres = torch.randn(WAYS, 1, 6, 5, generator=generator)
    support = centres + noise * torch.randn(WAYS, shots, 6, 5, generator=generator)
    queries = centres + noise * torch.randn(WAYS, QUERIES, 6, 5, generator=generator)
    targets = torch.arange(WAYS).repeat_interleave(QUERIES)
    return unit_norm(queries.flatten(0, 1)), unit_norm(support), targets


def distance(a, b):
    return math.sqrt(((a - b) ** 2).sum().item())


def to_way(x, support, way):
    return min(distance(x, shot) for shot in support[way])


@pytest.mark.parametrize("shots", [1, 3])
@pytest.mark.parametrize("mining", ["hardest", "all"])
def test_triplet_agrees_with_loops_over_distances(shots, mining):
    queries, support, targets = episode(shots)
    total = 0.0
    for query, own in zip(queries, targets.tolist(), strict=True):
        terms = [
            max(0, 0.5 + to_way(query, support, own) - to_way(query, support, other))
            for other in range(WAYS)
            if other != own
        ]
        total += max(terms) if mining == "hardest" else sum(terms) / len(terms)
    loss = Triplet(0.5, mining)(queries, support, targets, negative_distance).loss
    assert loss.item() == pytest.approx(total / len(queries), rel=1e-5)
    assert loss.item() > 0.05


@pytest.mark.parametrize("shots", [1, 2])
@pytest.mark.parametrize("mining", ["hardest", "all"])
def test_quadruplet_adds_pairs_of_other_ways(shots, mining):
    queries, support, targets = episode(shots, seed=1)
    total = 0.0
    for query, own in zip(queries, targets.tolist(), strict=True):
        near = to_way(query, support, own)
        others = [way for way in range(WAYS) if way != own]
        terms = [
            max(0, 0.4 + near - min(to_way(shot, support, b) for shot in support[a]))
            for a in others
            for b in others
            if a < b
        ]
        total += max(terms) if mining == "hardest" else sum(terms) / len(terms)
    score = negative_distance
    first = Triplet(0.5, mining)(queries, support, targets, score).loss
    both = Quadruplet(0.5, 0.4, mining)(queries, support, targets, score).loss
    assert (both - first).item() == pytest.approx(total / len(queries), rel=1e-5)
    assert both.item() > first.item()


def test_a_way_s_own_pairs_do_not_count_in_the_quadruplet():
    queries, support, targets = episode(seed=2, noise=0.01)
    support = support.clone()
    support[1] = support[0]  # two ways alike: no query of theirs sees the pair, the others do
    queries = support[targets, 0]
    loss = Quadruplet(0.1, 0.4)
    score = negative_distance
    of_pair = loss(queries[:4], support, targets[:4], score).loss
    first = Triplet(0.1)(queries[:4], support, targets[:4], score).loss
    of_others = loss(queries[4:], support, targets[4:], score).loss
    others_first = Triplet(0.1)(queries[4:], support, targets[4:], score).loss
    assert (of_pair - first).item() == pytest.approx(0, abs=1e-6)
    assert (of_others - others_first).item() > 0.3


def test_separated_places_cost_nothing():
    queries, support, targets = episode(noise=1e-3)
    for loss in (Triplet(0.2), Quadruplet(0.2, 0.2), Triplet(0.2, "all")):
        assert loss(queries, support, targets, negative_distance).loss.item() == 0
    entropy = OneShotCrossEntropy(10.0)(queries, support, targets, correlation).loss.item()
    assert 0 < entropy < 0.1  # cross-entropy is never done


@pytest.mark.parametrize("score", [correlation, cosine, negative_distance])
def test_cross_entropy_goes_with_every_similarity(score):
    queries, support, targets = episode(shots=2, seed=3)
    loss = OneShotCrossEntropy(7.0)
    value = loss(queries, support, targets, score)
    expected = F.cross_entropy(7.0 * class_scores(queries, support, score), targets)
    assert value.loss.item() == pytest.approx(expected.item(), rel=1e-6)
    right = class_scores(queries, support, score).argmax(1) == targets
    assert value.accuracy.item() == pytest.approx(right.float().mean().item())
    assert value.parts["W"].item() == 7.0


def test_a_turned_query_costs_nothing_under_correlation_alone():
    queries, support, targets = episode(noise=1e-3)
    turned = queries.roll(2, dims=-2)
    assert Triplet(0.2)(turned, support, targets, correlation).loss.item() == 0
    assert Triplet(0.2)(turned, support, targets, negative_distance).loss.item() > 0.1


@pytest.mark.parametrize("loss", [Triplet(), Quadruplet(), OneShotCrossEntropy(10.0)])
@pytest.mark.parametrize("score", [correlation, cosine, negative_distance])
def test_a_step_along_the_gradient_lowers_each_loss(loss, score):
    queries, support, targets = episode(seed=4)
    queries = queries.clone().requires_grad_()
    before = loss(queries, support, targets, score).loss
    (gradient,) = torch.autograd.grad(before, queries)
    assert gradient.abs().max() > 0
    after = loss(queries - 1e-3 * gradient / gradient.norm(), support, targets, score).loss
    assert after < before


def test_wrong_arguments_are_named():
    with pytest.raises(DeepringError, match=r"loss\.margin: 0"):
        Triplet(0)
    with pytest.raises(DeepringError, match=r"loss\.second_margin: -1"):
        Quadruplet(second_margin=-1)
    with pytest.raises(DeepringError, match=r"loss\.mining: 'hard'"):
        Triplet(mining="hard")
    queries, support, targets = episode()
    with pytest.raises(DeepringError, match=r"sampling\.ways: 2"):
        Quadruplet()(queries[:4], support[:2], targets[:4], negative_distance)
