"""Cross-entropy over a batch: against sums by hand, its gradient, and the turn of pairs."""

import math

import pytest
import torch

from deepring.errors import DeepringError
from deepring.training.batch_hard import ScanBatch
from deepring.training.batch_softmax import BatchSoftmax, BatchSoftmaxWithTurn

PLACES = torch.tensor([0, 0, 0, 1, 1, 2])
SAME = (PLACES[:, None] == PLACES[None]) & ~torch.eye(6, dtype=torch.bool)
DIFFERENT = PLACES[:, None] != PLACES[None]


def test_it_is_its_formula_for_each_pair_of_a_place():
    torch.manual_seed(0)
    vectors = torch.nn.functional.normalize(torch.randn(6, 4, dtype=torch.float64), dim=1)
    cosine = (vectors @ vectors.T).tolist()
    terms = []
    for a in range(6):
        others = sum(math.exp(cosine[a][n] / 0.3) for n in range(6) if DIFFERENT[a, n])
        for p in range(6):
            if SAME[a, p]:
                own = math.exp(cosine[a][p] / 0.3)
                terms.append(-math.log(own / (own + others)))
    assert len(terms) == 8
    value = BatchSoftmax(0.3)(vectors, SAME, DIFFERENT)
    assert float(value.loss) == pytest.approx(sum(terms) / 8)
    # The usual misreading: the other scans of the place among the candidates.
    with_own = torch.nn.functional.cross_entropy(
        torch.tensor(cosine, dtype=torch.float64).masked_fill(torch.eye(6) > 0, -torch.inf) / 0.3,
        torch.tensor([1, 2, 0, 4, 3, 0]),
    )
    assert float(value.loss) != pytest.approx(float(with_own), abs=0.05)


def test_scans_without_a_negative_and_far_descriptors_leave_the_gradient_finite():
    vectors = (1e4 * torch.arange(24.0).view(6, 4)).requires_grad_()
    none = torch.zeros(6, 6, dtype=torch.bool)
    for masks in ((SAME, DIFFERENT), (SAME, none), (none, none)):
        vectors.grad = None
        loss = BatchSoftmax()(vectors, *masks).loss
        loss.backward()
        assert torch.isfinite(vectors.grad).all()
    assert loss.item() == 0


def test_the_turn_of_pairs_is_least_where_the_orientations_say_so():
    torch.manual_seed(2)
    scene, other = torch.rand(12, 6), torch.rand(12, 6)
    turned = torch.tensor([0, 3, 7, 5, 5, 9])
    maps = torch.stack(
        [(other if p else scene).roll(int(t), 0) for p, t in zip(PLACES, turned, strict=True)]
    )
    loss = BatchSoftmaxWithTurn(turn_scale=200.0).requires_grad_(False)

    def turn(orientations):
        batch = ScanBatch(maps, SAME, DIFFERENT, orientations)
        return float(loss.of_batch(maps.flatten(1), maps, batch).parts["turn"])

    right = turn(turned + 0.3)
    assert right < 0.01
    assert turn(-turned) > right + 1  # the usual misreading: turned the other way
    parts = loss.of_batch(maps.flatten(1), maps, ScanBatch(maps, SAME, DIFFERENT, -turned.double()))
    expected = parts.parts["softmax"] + loss.turn_weight * parts.parts["turn"]
    assert float(parts.loss) == pytest.approx(float(expected))


def test_settings_that_mean_nothing_are_refused():
    with pytest.raises(DeepringError, match=r"loss\.temperature: 0"):
        BatchSoftmax(0)
    with pytest.raises(DeepringError, match=r"loss\.turn_weight: -1"):
        BatchSoftmaxWithTurn(turn_weight=-1)
