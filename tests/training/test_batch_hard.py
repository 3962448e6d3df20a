"""The batch-hard scheme: masks, growth and turns of batches; its loss against sums by hand."""

import dataclasses
import itertools

import numpy as np
import pytest
import torch

from deepring.data.packed_rasters import pack
from deepring.errors import DeepringError
from deepring.training.batch_hard import BatchHardScheme, BatchHardTriplet
from helpers.training_scans import RASTER, some_scans

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
        ({"hard": 1.5}, r"sampling\.hard: 1\.5"),
        ({"hard_from": -1}, r"sampling\.hard_from: -1"),
        ({"candidates": 0}, r"sampling\.candidates: 0"),
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


def hinges_by_hand(vectors, places, margin):
    """FaceNet's semi-hard triplets, pair by pair."""
    apart, found = torch.cdist(vectors, vectors), []
    for a, p in itertools.permutations(range(len(places)), 2):
        others = [float(apart[a, n]) for n in range(len(places)) if places[n] != places[a]]
        if places[a] == places[p]:
            beyond = [d for d in others if d > apart[a, p]]
            found.append(margin + float(apart[a, p]) - min(beyond, default=max(others)))
    return [max(0.0, h) for h in found]


def test_semihard_triplets_take_the_nearest_negative_beyond_the_positive():
    torch.manual_seed(4)
    places = torch.tensor([0, 0, 0, 1, 1, 2])
    vectors = torch.rand(6, 4, dtype=torch.float64) + 0.2 * places[:, None]
    vectors[0] += 9  # farther from its own place than from any other
    same = (places[:, None] == places[None]) & ~torch.eye(6, dtype=torch.bool)
    value = BatchHardTriplet(0.2, "semihard")(vectors, same, places[:, None] != places[None])
    hinges = hinges_by_hand(vectors, places, 0.2)
    active = [h for h in hinges if h > 0]
    assert 0 < len(active) < len(hinges)
    assert float(value.loss) == pytest.approx(sum(active) / len(active), abs=1e-6)
    assert float(value.parts["active"]) == pytest.approx(len(active) / len(hinges))


def test_the_warm_up_takes_all_triplets_and_is_counted_in_the_state():
    torch.manual_seed(1)
    places = torch.tensor([0, 0, 0, 1, 1, 2])
    vectors = torch.rand(6, 4) + 0.3 * places[:, None]
    same = (places[:, None] == places[None]) & ~torch.eye(6, dtype=torch.bool)
    batch = vectors, same, places[:, None] != places[None]
    every, hardest = (float(BatchHardTriplet(0.2, m)(*batch).loss) for m in ("all", "hardest"))
    warm = BatchHardTriplet(0.2, warm_up=2)
    losses = [float(warm(*batch).loss)]
    assert float(warm.eval()(*batch).loss) == every  # validation does not count
    resumed = BatchHardTriplet(0.2, warm_up=2)
    resumed.load_state_dict(warm.state_dict())
    losses += [float(resumed(*batch).loss) for _ in range(2)]
    assert losses == [every, every, hardest]
    assert every != hardest


def test_hard_pairs_look_like_the_pair_before_and_are_elsewhere():
    hard = dataclasses.replace(SETTINGS, hard=1.0, candidates=48)
    made = hard.training_set(some_scans(), seed=0)
    rng = np.random.default_rng(0)
    plain = SETTINGS.training_set(some_scans(), seed=0)
    # Nothing is hard before the first descriptors.
    assert (made.sample(np.random.default_rng(1)) == plain.sample(np.random.default_rng(1))).all()
    place = np.arange(48) // 4
    made.vectors = torch.from_numpy(np.exp2(place % 6))[:, None]  # place k looks like k + 6
    for _ in range(20):
        anchors = made.sample(rng)[::2]
        assert len(set(anchors.tolist())) == 4
        first, second = place[anchors[:2]]
        assert second == (first + 6) % 12
    # Half of them: the others are drawn at random.
    some = dataclasses.replace(hard, hard=0.5).training_set(some_scans(), seed=0)
    some.vectors = made.vectors
    pairs = [place[some.sample(rng)[:3:2]] for _ in range(60)]
    assert 20 < sum(b == (a + 6) % 12 for a, b in pairs) < 45


def test_scans_of_a_pair_differ_by_the_turn_that_their_orientations_tell():
    step, rng = 2 * np.pi / 24, np.random.default_rng(1)
    turns = rng.integers(24, size=48)
    made = BatchHardScheme(size=8, limit=8, positive_radius=3.0, negative_radius=20.0).training_set(
        some_scans(headings=turns * step), seed=2
    )
    # All scans show one scene; a robot turned by +h sees it turned by -h.
    scene = rng.random((24, 4)) < 0.3
    seen = np.stack([pack(np.roll(scene, -int(h), axis=0), RASTER) for h in turns])
    object.__setattr__(made.scans.rasters, "data", seen)
    batch = made[0]
    between = (batch.orientations[:, None] - batch.orientations[None]).round().long() % 24
    assert len(between.unique()) > 5
    for i, j in itertools.product(range(8), repeat=2):
        assert torch.equal(batch.rasters[i], batch.rasters[j].roll(int(between[i, j]), dims=0))


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
