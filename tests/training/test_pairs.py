"""The pair scheme: which scans are drawn, what is hidden; its losses against sums by hand."""

import math

import numpy as np
import pytest
import torch

from deepring.errors import DeepringError
from deepring.rasters import HistogramRaster
from deepring.training.pairs import Contrastive, PairDescriptors, PairScheme, SoftMatch
from helpers.training_scans import some_scans

#: Scans 2 m apart are of one place, those 100 m apart of two, those 4 and 6 m apart of neither.
SETTINGS = {"pairs": 10, "positive_radius": 3.0, "negative_radius": 20.0}


def pairs_of(distances, same, metres=None, logits=None):
    """Pairs of vectors at these distances."""
    second = torch.zeros(len(distances), 3, dtype=torch.float64)
    second[:, 1] = torch.tensor(distances, dtype=torch.float64)
    metres = torch.zeros(len(distances)) if metres is None else torch.tensor(metres)
    logits = None if logits is None else torch.tensor(logits)
    return PairDescriptors(torch.zeros_like(second), second, logits, torch.tensor(same), metres)


@pytest.mark.parametrize(("share", "number"), [(0.5, 5), (0.0, 0), (1.0, 10), (0.25, 2)])
def test_pairs_are_of_one_place_or_of_two(share, number):
    made = PairScheme(**SETTINGS, same=share).training_set(some_scans(), seed=0)
    for index in range(10):
        batch = made[index]
        assert batch.rasters.shape == (20, 24, 4)
        assert int(batch.same.sum()) == number
        assert (batch.metres[batch.same] == 2).all()
        assert (batch.metres[~batch.same] >= 94).all()


def test_rasters_are_those_of_the_numbers_that_are_drawn():
    scans = some_scans()
    made = PairScheme(**SETTINGS).training_set(scans, seed=3)
    numbers = made.sample(np.random.default_rng([3, 7]))
    batch = made[7]
    assert torch.equal(batch.rasters[:10], scans.rasters[numbers[:, 0]])
    assert torch.equal(batch.rasters[10:], scans.rasters[numbers[:, 1]])
    assert (numbers[:, 0] != numbers[:, 1]).all()
    assert torch.equal(made[7].rasters, batch.rasters)
    assert not torch.equal(made[8].rasters, batch.rasters)


def test_all_scans_take_part_before_one_comes_twice():
    made = PairScheme(pairs=48, same=1.0).training_set(some_scans(), seed=0)
    numbers = made.sample(np.random.default_rng(0))
    assert sorted(numbers[:, 0].tolist()) == list(range(48))


def test_both_scans_of_a_pair_lose_the_same_sector():
    plain, hidden = (
        PairScheme(**SETTINGS, hidden=share, hidden_width=180.0).training_set(some_scans(), seed=1)
        for share in (0.0, 0.5)
    )
    lost_by_pair, widths = [], []
    for index in range(6):
        whole = torch.ones_like(plain[index].rasters)
        lost = (hidden._hide(whole, np.random.default_rng(index)) == 0).all(dim=-1)
        assert torch.equal(lost[:10], lost[10:])
        lost_by_pair += lost[:10].any(dim=1).tolist()
        for row in lost[:10].int():
            edges = int((row != row.roll(1)).sum())
            assert edges in (0, 2)  # one sector, which may go round the end
            widths.append(int(row.sum()))
        seen = hidden[index].rasters
        assert ((seen == plain[index].rasters) | (seen == 0)).all()
    assert 0.2 < np.mean(lost_by_pair) < 0.7
    assert 6 < max(widths) <= 12


def test_turned_scans_are_the_same_scans_turned():
    plain, turned = (
        PairScheme(**SETTINGS, turned=t).training_set(some_scans(), seed=3)[1].rasters
        for t in (False, True)
    )
    shifts = [
        [k for k in range(24) if torch.equal(a.roll(k, dims=0), b)]
        for a, b in zip(plain, turned, strict=True)
    ]
    assert all(shifts)
    assert len({tuple(s) for s in shifts}) > 5


def test_contrastive_is_its_formula():
    for distance, same, expected in ((5.0, True, 12.5), (5.0, False, 24.5), (13.0, False, 0.0)):
        value = Contrastive(12.0)(pairs_of([distance], [same]))
        assert float(value.loss) == pytest.approx(expected)
    value = Contrastive(12.0)(pairs_of([5.0, 13.0, 5.0, 7.0], [True, False, False, True]))
    assert float(value.loss) == pytest.approx((25 + 0 + 49 + 49) / 8)
    assert float(value.accuracy) == pytest.approx(0.5)
    assert float(value.parts["active"]) == pytest.approx(0.5)


def test_far_pairs_of_two_places_and_equal_ones_leave_the_gradient_finite():
    first = torch.tensor([[0.0, 0.0], [0.0, 0.0]], requires_grad=True)
    second = torch.tensor([[13.0, 0.0], [0.0, 0.0]])
    pairs = PairDescriptors(first, second, None, torch.tensor([False, False]), torch.ones(2))
    Contrastive(12.0)(pairs).loss.backward()
    assert first.grad is not None
    assert torch.equal(first.grad[0], torch.zeros(2))
    assert torch.isfinite(first.grad).all()


def test_targets_fall_with_the_metres():
    metres = torch.tensor([0.0, 2.9, 3.0, 5.0, 10.0, 13.3, 20.0], dtype=torch.float64)
    expected = [1.0, 1.0, 0.99068, 0.96555, 0.5, 0.09975, 0.00127]
    assert SoftMatch().targets(metres).tolist() == pytest.approx(expected, abs=1e-5)


def test_soft_match_is_its_formula():
    metres, logits, distances = [1.0, 8.0, 30.0], [2.0, -0.5, 0.3], [0.1, 0.5, 0.05]
    pairs = pairs_of(distances, [True, True, False], metres, logits)
    terms = []
    for far, logit, d in zip(metres, logits, distances, strict=True):
        y = 1.0 if far < 3 else 1 / (1 + math.exp(-(10 - far) / 1.5))
        p = 1 / (1 + math.exp(-logit))
        match = -(y * math.log(p) + (1 - y) * math.log(1 - p))
        terms.append((match, y * d**2 + (1 - y) * max(0.2 - d, 0) ** 2))
    match, apart = np.mean(terms, axis=0)
    value = SoftMatch()(pairs)
    assert float(value.loss) == pytest.approx(match + apart, rel=1e-5)
    assert float(value.parts["match"]) == pytest.approx(match, rel=1e-5)
    assert float(SoftMatch(contrastive=0.0)(pairs).loss) == pytest.approx(match, rel=1e-5)
    assert float(value.accuracy) == pytest.approx(1 / 3)


def test_what_cannot_be_drawn_or_lost_is_refused():
    scans = some_scans()
    for values, complaint in (
        ({"positive_radius": 1.0}, r"sampling\.positive_radius: none of 48 training scans"),
        ({"negative_radius": 5e3}, r"sampling\.negative_radius: none of 48 training scans"),
    ):
        with pytest.raises(DeepringError, match=complaint):
            PairScheme(**{**SETTINGS, **values}).training_set(scans, seed=0)
    for values, complaint in (
        ({"pairs": 1}, r"sampling\.pairs: 1"),
        ({"same": 1.5}, r"sampling\.same: 1\.5"),
        ({"per_epoch": 0}, r"sampling\.per_epoch: 0"),
        ({"positive_radius": 21.0}, r"sampling\.positive_radius: 21\.0"),
        ({"hidden": -0.1}, r"sampling\.hidden: -0\.1"),
        ({"hidden_width": 400.0}, r"sampling\.hidden_width: 400"),
    ):
        with pytest.raises(DeepringError, match=complaint):
            PairScheme(**{**SETTINGS, **values})
    ranges = some_scans(raster=HistogramRaster(buckets=20))
    with pytest.raises(DeepringError, match=r"sampling\.hidden: .* takes a HistogramRaster"):
        PairScheme(**SETTINGS, hidden=0.5).training_set(ranges, seed=0)
    for wrong in ({"margin": 0}, {"width": 0}, {"certain": -1}, {"contrastive": -1}, {"middle": 0}):
        with pytest.raises(DeepringError, match=rf"loss\.{next(iter(wrong))}: "):
            SoftMatch(**wrong)
    with pytest.raises(DeepringError, match=r"loss\.margin: 0"):
        Contrastive(0)
    with pytest.raises(
        DeepringError, match=r"loss: SoftMatch, expected a method with match_logits"
    ):
        SoftMatch()(pairs_of([1.0], [True]))
