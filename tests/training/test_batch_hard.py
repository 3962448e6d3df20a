"""The batch-hard scheme: masks, growth and turns of batches; its loss against sums by hand."""

import itertools

import numpy as np
import pytest
import torch

from deepring.errors import DeepringError
from deepring.training.batch_hard import BatchHardScheme, BatchHardTriplet
from helpers.training_scans import some_scans

SETTINGS = BatchHardScheme(
    size=8, limit=20, positive_radius=3.0, negative_radius=20.0, turned=False
)


def test_a_batch_holds_pairs_and_its_masks_tell_places_apart():
    made = SETTINGS.training_set(some_scans(), seed=0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        scans = made.sample(rng)
        assert len(set(scans.tolist())) == len(scans) == 8
    batch = made[4]
    assert batch.rasters.shape == (8, 24, 4)
    assert batch.positives.any(dim=1).all()
    assert not batch.positives.diagonal().any()
    assert torch.equal(batch.positives, batch.positives.T)
    assert not (batch.positives & batch.negatives).any()
    # Scans of a place 4 and 6 m apart are neither the same nor different.
    everything = BatchHardScheme(
        size=48, limit=48, positive_radius=3.0, negative_radius=20.0, turned=False
    )
    whole = everything.training_set(some_scans(), seed=0)[0]
    itself = torch.eye(len(whole.rasters), dtype=torch.bool)
    neither = ~whole.positives & ~whole.negatives & ~itself
    assert len(whole.rasters) > 40
    assert neither.any()
    assert torch.equal(neither, neither.T)


def test_batches_grow_to_their_limit_by_even_steps():
    made = SETTINGS.training_set(some_scans(), seed=0)
    sizes = []
    for _ in range(5):
        sizes.append(len(made[0].rasters))
        made.expand()
    assert sizes == [8, 10, 14, 18, 20]


def test_turned_scans_are_the_same_scans_turned():
    plain, turned = (
        BatchHardScheme(
            size=8, limit=8, positive_radius=3.0, negative_radius=20.0, turned=t
        ).training_set(some_scans(), seed=3)[1]
        for t in (False, True)
    )
    moved = 0
    for a, b in zip(plain.rasters, turned.rasters, strict=True):
        shifts = [k for k in range(24) if torch.equal(a.roll(k, dims=0), b)]
        assert shifts
        moved += shifts != [0]
    assert moved > 3


def test_too_few_pairs_are_refused():
    with pytest.raises(DeepringError, match=r"sampling\.size: 8 scans in pairs, but only 0 of 48"):
        BatchHardScheme(size=8, positive_radius=1.0).training_set(some_scans(), seed=0)
    for values, complaint in (
        ({"size": 7}, r"sampling\.size: 7"),
        ({"limit": 16}, r"sampling\.limit: 16"),
        ({"expand_by": 0.5}, r"sampling\.expand_by: 0\.5"),
        ({"positive_radius": 11.0}, r"sampling\.positive_radius: 11\.0"),
    ):
        with pytest.raises(DeepringError, match=complaint):
            BatchHardScheme(**values)


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


def test_a_loss_of_no_margin_is_refused():
    with pytest.raises(DeepringError, match=r"loss\.margin: -1"):
        BatchHardTriplet(-1)
    with pytest.raises(DeepringError, match=r"loss\.mining: 'some'"):
        BatchHardTriplet(mining="some")
