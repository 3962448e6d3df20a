"""Batches of pairs: masks, growth, turns."""

import numpy as np
import pytest
import torch
from test_tuples import pool

from deepring.errors import DeepringError
from deepring.training.scan_batches import ScanBatchSettings

SETTINGS = ScanBatchSettings(size=8, limit=20, same=3.0, different=20.0, turned=False)


def test_a_batch_holds_pairs_and_its_masks_tell_places_apart():
    made = SETTINGS.training_set(pool(), seed=0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        scans = made.draw(rng)
        assert len(set(scans.tolist())) == len(scans) == 8
    batch = made[4]
    assert batch.rasters.shape == (8, 24, 4)
    assert batch.same.any(dim=1).all()
    assert not batch.same.diagonal().any()
    assert torch.equal(batch.same, batch.same.T)
    assert not (batch.same & batch.different).any()
    # Scans of a place 4 and 6 m apart are neither the same nor different.
    everything = ScanBatchSettings(size=48, limit=48, same=3.0, different=20.0, turned=False)
    whole = everything.training_set(pool(), seed=0)[0]
    itself = torch.eye(len(whole.rasters), dtype=torch.bool)
    neither = ~whole.same & ~whole.different & ~itself
    assert len(whole.rasters) > 40
    assert neither.any()
    assert torch.equal(neither, neither.T)


def test_batches_grow_to_their_limit_by_even_steps():
    made = SETTINGS.training_set(pool(), seed=0)
    sizes = []
    for _ in range(5):
        sizes.append(len(made[0].rasters))
        made.expand()
    assert sizes == [8, 10, 14, 18, 20]


def test_turned_scans_are_the_same_scans_turned():
    plain, turned = (
        ScanBatchSettings(size=8, limit=8, same=3.0, different=20.0, turned=t).training_set(
            pool(), seed=3
        )[1]
        for t in (False, True)
    )
    moved = 0
    for a, b in zip(plain.rasters, turned.rasters, strict=True):
        shifts = [k for k in range(24) if torch.equal(a.roll(k, dims=0), b)]
        assert shifts
        moved += shifts != [0]
    assert moved > 3


def test_too_few_pairs_are_refused():
    with pytest.raises(DeepringError, match=r"drawing\.size: 8 scans in pairs, but only 0 of 48"):
        ScanBatchSettings(size=8, same=1.0).training_set(pool(), seed=0)
    for values, complaint in (
        ({"size": 7}, r"drawing\.size: 7"),
        ({"limit": 16}, r"drawing\.limit: 16"),
        ({"expand_by": 0.5}, r"drawing\.expand_by: 0\.5"),
        ({"same": 11.0}, r"drawing\.same: 11\.0"),
    ):
        with pytest.raises(DeepringError, match=complaint):
            ScanBatchSettings(**values)
