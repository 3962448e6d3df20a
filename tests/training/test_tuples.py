"""Tuples: who is drawn with whom, hard negatives, turned queries."""

import numpy as np
import pytest
import torch

from deepring.data.packed_rasters import pack
from deepring.errors import DeepringError
from deepring.rasters import BevRaster
from deepring.training.tuples import TupleScheme
from helpers.training_scans import RASTER, some_scans

SETTINGS = TupleScheme(
    per_batch=3, positives=2, negatives=4, hard=2, positive_radius=10.0, negative_radius=50.0
)


def drawn(made, count=50):
    rng = np.random.default_rng(3)
    return [made.sample(int(query), rng) for query in rng.choice(made.queries, count)]


def test_a_tuple_holds_its_place_other_places_and_yet_another():
    made = SETTINGS.training_set(some_scans(), seed=0)
    x = made.scans.positions[:, 0]
    for query, *rest in drawn(made):
        positives, negatives, other = rest[:2], rest[2:6], rest[6]
        assert len({query, *positives}) == 3
        assert all(abs(x[k] - x[query]) <= 10 for k in positives)
        assert len(set(negatives)) == 4
        assert all(abs(x[k] - x[query]) > 50 for k in negatives)
        assert all(abs(x[other] - x[k]) > 50 for k in (query, *negatives))


def test_every_scan_is_a_query_once_an_epoch_and_epochs_differ():
    made = SETTINGS.training_set(some_scans(), seed=0)
    assert len(made) == 16  # 48 scans in threes

    def queries(epoch):
        found = []
        for number in range(16):
            rasters = made[epoch * 16 + number].rasters[:, 0]
            same = (rasters[:, None] == made.scans.rasters[np.arange(48)][None]).flatten(2).all(2)
            found += same.int().argmax(1).tolist()
        return found

    assert sorted(queries(0)) == sorted(queries(1)) == list(range(48))
    assert queries(0) != queries(1)


def test_a_batch_is_the_same_whenever_it_is_drawn_and_another_seed_is_another():
    one, two = (SETTINGS.training_set(some_scans(), seed=5) for _ in range(2))
    one[0]
    assert torch.equal(one[7].rasters, two[7].rasters)
    other = SETTINGS.training_set(some_scans(), seed=6)
    assert not torch.equal(one[7].rasters, other[7].rasters)


def test_hard_negatives_are_the_most_alike_of_other_places():
    made = SETTINGS.training_set(some_scans(), seed=0)
    vectors = torch.arange(48.0)[:, None]  # the most alike are the neighbours in number
    made.vectors = vectors
    for query, *rest in drawn(made):
        negatives, other = rest[2:6], rest[6]
        apart = sorted(abs(k - query) for k in range(48) if k // 4 not in (query // 4, other // 4))
        found = sorted(abs(k - query) for k in negatives)
        assert found[:2] == apart[:2]
        assert len(set(negatives)) == 4
    # Without hard negatives nothing is learnt of them.
    plain = TupleScheme(per_batch=3, negatives=4, hard=0).training_set(some_scans(), seed=0)
    before = drawn(plain)
    plain.vectors = vectors
    assert all((a == b).all() for a, b in zip(before, drawn(plain), strict=True))


def test_a_turned_query_is_its_aligned_positive_turned_by_the_label():
    step = 2 * np.pi / 24
    rng = np.random.default_rng(1)
    turns = rng.integers(24, size=48)
    made = TupleScheme(per_batch=4, positives=2, negatives=4, hard=0, turned=True).training_set(
        some_scans(headings=turns * step), seed=2
    )
    # All scans show one scene; a robot turned by +h sees it turned by -h.
    scene = torch.from_numpy(rng.random((24, 4)) < 0.3).to(torch.uint8)
    seen = [np.roll(scene.numpy(), -int(h), axis=0).astype(bool) for h in turns]
    object.__setattr__(made.scans.rasters, "data", np.stack([pack(s, RASTER) for s in seen]))
    labels = set()
    for index in range(6):
        rasters, positives, turn = made[index]
        for tuple_, shift in zip(rasters, turn.tolist(), strict=True):
            query, aligned = tuple_[0], tuple_[1 : 1 + positives]
            for positive in aligned:
                assert torch.equal(query, positive.roll(shift, dims=0))
            labels.add(shift)
    assert len(labels) > 5


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"positives": 0}, r"sampling\.positives: 0"),
        ({"hard": 19}, r"sampling\.hard: 19, expected 0 to sampling\.negatives=18"),
        (
            {"positive_radius": 60.0},
            r"sampling\.positive_radius: 60\.0 m, sampling\.negative_radius: 50\.0 m",
        ),
        ({"per_epoch": 0}, r"sampling\.per_epoch: 0"),
    ],
)
def test_settings_that_draw_nothing_are_refused(values, complaint):
    with pytest.raises(DeepringError, match=complaint):
        TupleScheme(**values)


def test_scans_that_hold_too_little_are_refused():
    with pytest.raises(DeepringError, match="none of 48 training scans has 9 other scans"):
        TupleScheme(positives=9).training_set(some_scans(), seed=0)
    with pytest.raises(DeepringError, match="no 18 of 24 training scans"):
        TupleScheme(negatives=18, hard=0).training_set(some_scans(places=6), seed=0)
    bev = BevRaster(cells=16)
    with pytest.raises(DeepringError, match="BevRaster cannot be turned"):
        TupleScheme(turned=True).training_set(some_scans(raster=bev), seed=0)
