"""The one-shot classifier: W C + b by loops, a bias without gradient, the best of several shots."""

import itertools

import pytest
import torch
import torch.nn.functional as F

from deepring.core.correlation import circular_cross_correlation, unit_norm
from deepring.training.episodes import OneShotClassifier


def score(queries, database):
    return circular_cross_correlation(queries, database).score


def maps(*shape, seed=0):
    return unit_norm(torch.randn(*shape, generator=torch.Generator().manual_seed(seed)))


def correlation_by_loop(query, entry):
    """max over α of Σ_θ Σ_ω Q(θ + α, ω) S(θ, ω), Eq. 8."""
    rows = len(query)
    return max(
        sum(float(query[(theta + alpha) % rows] @ entry[theta]) for theta in range(rows))
        for alpha in range(rows)
    )


@pytest.mark.parametrize("shots", [1, 3])
def test_logits_against_a_loop(shots):
    classifier = OneShotClassifier(7.0)
    with torch.no_grad():
        classifier.bias.fill_(-2.5)
    queries, support = maps(4, 6, 5), maps(3, shots, 6, 5, seed=1)
    logits = classifier(queries, support, score)
    assert logits.shape == (4, 3)
    for q, way in itertools.product(range(4), range(3)):
        best = max(correlation_by_loop(queries[q], shot) for shot in support[way])
        assert logits[q, way].item() == pytest.approx(7.0 * best - 2.5, abs=1e-4)


def test_several_shots_take_the_best_and_not_the_mean_or_a_neighbours():
    queries = maps(2, 8, 5)
    support = maps(2, 3, 8, 5, seed=1)
    support[0, 2] = queries[0].roll(3, dims=0)  # the last shot of the first way, turned
    support[1, 0] = queries[1]
    logits = OneShotClassifier(1.0)(queries, support, score)
    assert torch.allclose(logits.diagonal(), torch.ones(2), atol=1e-5)
    assert torch.equal(logits.argmax(1), torch.arange(2))
    means = torch.stack([OneShotClassifier(1.0)(queries, s[:, None], score) for s in support]).mean(
        2
    )
    assert (means.T.diagonal() < 0.9).all()


def test_the_order_of_the_shots_does_not_matter():
    queries, support = maps(4, 6, 5), maps(3, 4, 6, 5, seed=2)
    classifier = OneShotClassifier()
    assert torch.allclose(
        classifier(queries, support, score), classifier(queries, support.flip(1), score), atol=1e-4
    )


def test_the_bias_cancels_in_the_softmax():
    classifier, queries, support = OneShotClassifier(10.0), maps(6, 8, 5), maps(3, 1, 8, 5, seed=3)
    plain = classifier(queries, support, score).softmax(1)
    with torch.no_grad():
        classifier.bias.fill_(3.0)
    assert torch.allclose(classifier(queries, support, score).softmax(1), plain, atol=1e-6)


def test_the_bias_has_no_gradient_and_the_weight_has_one():
    classifier = OneShotClassifier(10.0)
    logits = classifier(maps(6, 8, 5), maps(3, 1, 8, 5, seed=4), score)
    F.cross_entropy(logits, torch.arange(6) % 3).backward()
    assert abs(classifier.bias.grad.item()) < 1e-7  # rounding, some 1e-8
    assert abs(classifier.weight.grad.item()) > 1e-3
    # A sigmoid for each way, as binary classifiers have, would move it.
    classifier.zero_grad()
    targets = F.one_hot(torch.arange(6) % 3).float()
    logits = classifier(maps(6, 8, 5), maps(3, 1, 8, 5, seed=4), score)
    F.binary_cross_entropy_with_logits(logits, targets).backward()
    assert abs(classifier.bias.grad.item()) > 1e-3


def test_a_turned_query_has_the_same_logits():
    classifier, queries, support = OneShotClassifier(), maps(4, 12, 5), maps(3, 2, 12, 5, seed=5)
    turned = queries.roll(5, dims=1)
    assert torch.allclose(
        classifier(turned, support, score), classifier(queries, support, score), atol=1e-4
    )


def test_gradients_reach_queries_and_support():
    queries, support = maps(2, 6, 5).requires_grad_(), maps(3, 1, 6, 5, seed=6).requires_grad_()
    F.cross_entropy(OneShotClassifier()(queries, support, score), torch.tensor([0, 1])).backward()
    assert queries.grad.abs().sum() > 0
    assert support.grad.abs().sum() > 0


def test_it_has_two_numbers_to_learn():
    classifier = OneShotClassifier(42)
    assert {name: p.shape for name, p in classifier.named_parameters()} == {
        "weight": torch.Size([]),
        "bias": torch.Size([]),
    }
    assert classifier.weight.item() == 42.0
    assert classifier.bias.item() == 0.0
