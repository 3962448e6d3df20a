"""Training on segments: what is one thing, what a segment loses, the loss's terms and heads."""

import math

import numpy as np
import pytest
import torch

from deepring.data.packed_rasters import Rasters, pack
from deepring.errors import ConfigError, DataError
from deepring.methods.locus import Locus, LocusSettings
from deepring.rasters import SegmentsRaster, raster_settings
from deepring.rasters.segment_shape import voxels
from deepring.training.pairs import Contrastive
from deepring.training.segments import SegmentIdentity, SegmentScheme
from deepring.training.segments.identities import in_world, segment_identities
from deepring.training.segments.segment_augmentation import SegmentAugmentation, voxel_points
from deepring.training.training_scans import TrainingScans
from helpers.training_scans import some_scans

RASTER = SegmentsRaster(
    max_segments=10, cells=(8, 8, 4), tolerance=0.6, least_points=20, most_points=500
)
SCHEME = SegmentScheme(size=6, identities=20)


def drive(scans=6, number=5, seed=0):
    """Lumps that stand still, seen from scans 2 m apart that turn."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-25, 25, (number, 2))
    lumps = [
        np.column_stack([place + rng.uniform(-0.4, 0.4, (80, 2)), rng.uniform(1, 3, 80)])
        for place in places
    ]
    positions = np.column_stack([2.0 * np.arange(scans), np.zeros(scans)])
    headings = 0.7 * np.arange(scans)
    images = []
    for position, heading in zip(positions, headings, strict=True):
        c, s = np.cos(heading), np.sin(heading)
        points = np.concatenate(lumps) - [*position, 0]
        points[:, :2] = points[:, :2] @ [[c, -s], [s, c]]
        images.append(pack(RASTER(points.astype(np.float32), 0.0), RASTER))
    zeros = np.zeros(scans, dtype=np.int64)
    rasters = Rasters(np.stack(images), RASTER)
    return TrainingScans(positions, zeros, headings, rasters, zeros)


def test_things_are_told_by_where_they_stand():
    scans = drive()
    batches = SegmentScheme(size=30).training_set(scans, seed=0)
    assert len(batches.identity) == 30  # five lumps in six scans
    assert np.bincount(batches.identity).tolist() == [6] * 5
    # Every scan has each once, and headings of the wrong sign tell nothing.
    assert len(np.unique(np.column_stack([batches.scan, batches.identity]), axis=0)) == 30
    astray = TrainingScans(
        scans.positions, scans.dataset, -scans.headings, scans.rasters, scans.session
    )
    with pytest.raises(DataError, match=r"sampling\.radius: the segments of 6 training scans"):
        SegmentScheme(views=4).training_set(astray, seed=0)


def test_centres_go_into_the_world_by_heading_and_position():
    moved = in_world(np.array([[5.0, 1, 2]]), np.array([[10.0, 20]]), np.array([np.pi / 2]))
    assert np.allclose(moved, [[9, 25, 2]])


def test_identities_by_hand():
    # Two things 3 m apart; scan 0 sees the first twice, and its nearer segment counts.
    centres = np.array([[0, 0, 0], [0.5, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [3, 0, 0], [3.3, 0, 0]])
    scans = np.array([0, 0, 1, 2, 1, 2])
    assert segment_identities(centres, scans).tolist() in ([0, -1, 0, 0, 1, 1], [-1, 0, 0, 0, 1, 1])
    # No chains: what is 1.5 m from the anchor is not the anchor's thing.
    row = np.array([[0.0, 0, 0], [0.75, 0, 0], [1.5, 0, 0], [2.25, 0, 0]])
    assert len(set(segment_identities(row, np.arange(4)).tolist())) == 2
    assert segment_identities(np.zeros((3, 3)), np.zeros(3, dtype=np.int64)).tolist() == [-1] * 3
    assert segment_identities(np.zeros((0, 3)), np.zeros(0, dtype=np.int64)).tolist() == []
    # Another dataset is another world.
    apart = np.column_stack([np.zeros((2, 3)), [0, 1e6]])
    assert segment_identities(apart, np.arange(2)).tolist() == [-1, -1]


def test_only_what_is_seen_often_and_most_often_is_learned():
    scans = drive()
    assert SegmentScheme(views=6).training_set(scans, 0).identity.max() == 4
    with pytest.raises(DataError, match="7 scans see"):
        SegmentScheme(views=7).training_set(scans, 0)
    assert SegmentScheme(identities=3).training_set(scans, 0).identity.max() == 2


def test_batches_depend_on_their_number_and_take_each_segment_in_turn():
    first, again = (SCHEME.training_set(drive(), seed=3) for _ in range(2))
    assert len(first) == 5
    for a, b in zip(first[7], again[7], strict=True):
        assert torch.equal(a, b)
    chosen = np.concatenate([first._chosen(k) for k in range(5)])
    assert sorted(chosen) == list(range(30))
    batch = first[0]
    assert batch.voxels.shape == (6, 8, 8, 4)
    assert batch.voxels.dtype == torch.uint8
    assert batch.extents.shape == (6, 3)
    assert batch.identity.dtype == torch.int64
    plain = SegmentScheme(size=6, turned=False, dropped=0.0, cut=0.0).training_set(drive(), 3)[0]
    assert batch.voxels.sum() < plain.voxels.sum()


def test_a_segment_loses_as_much_as_is_said():
    rng = np.random.default_rng(0)
    part = rng.uniform(-1, 1, (400, 3)) * [3, 1, 1]
    grid, extents = voxels(part, (16, 16, 8))
    extents = extents.astype(np.float32)
    count = len(voxel_points(grid, extents))
    assert count == grid.sum()
    same, _ = SegmentAugmentation(turned=False, dropped=0.0, cut=0.0)(grid, extents, rng)
    assert abs(int(same.sum()) - count) <= 0.2 * count  # other borders of voxels
    for _ in range(20):
        less, lengths = SegmentAugmentation(turned=False, dropped=0.0, cut=0.5)(grid, extents, rng)
        assert less.any()
        assert (lengths <= extents + 1e-4).all()
    _, lengths = SegmentAugmentation(dropped=0.0, cut=0.0)(grid, extents, rng)
    assert lengths[1] > extents[1]  # no longer along its own axes
    tiny = np.zeros((8, 8, 4), dtype=bool)
    tiny[4, 4, 2] = True
    for _ in range(20):
        kept, _ = SegmentAugmentation()(tiny, np.zeros(3, np.float32), rng)
        assert kept.any()


@torch.no_grad()
def test_the_loss_by_hand():
    torch.manual_seed(0)
    loss = SegmentIdentity(4, feature=3, cells=(4, 4, 4), reconstruction=2.0, dropout=0.0).eval()
    f, x, y = torch.rand(5, 3), (torch.rand(5, 4, 4, 4) < 0.3).to(torch.uint8), torch.arange(5) % 4
    step = loss(f, x, y)
    p = torch.softmax(loss.classes(f), dim=1)
    told = -p[torch.arange(5), y].log().mean()
    q, t = torch.sigmoid(loss.decoder(f)[:, 0]), x.float()
    seen = -(0.9 * t * q.log() + 0.1 * (1 - t) * (1 - q).log()).mean()
    assert float(step.loss) == pytest.approx(float(told + 2 * seen), rel=1e-4)
    assert step.parts.keys() == {"identity", "voxels"}
    assert float(step.accuracy) == pytest.approx(float((p.argmax(1) == y).float().mean()))


def test_the_heads_have_segmaps_sizes():
    loss = SegmentIdentity(identities=100)
    decoder = sum(p.numel() for p in loss.decoder.parameters())
    assert decoder == 64 * 8192 + 8192 + 2 * 27 * 32 * 32 + 27 * 32
    assert sum(p.numel() for p in loss.classes.parameters()) == 128 + 64 * 100 + 100
    assert loss.decoder(torch.zeros(2, 64)).shape == (2, 1, 32, 32, 16)


def test_a_few_steps_tell_the_things_apart():
    torch.manual_seed(0)
    scheme = SegmentScheme(size=10, identities=8, turned=False, dropped=0.0, cut=0.0)
    settings = LocusSettings(raster_settings(RASTER), (2, 4, 4), hidden=32, feature=16)
    method = Locus(settings).train()
    loss = SegmentIdentity(8, feature=16, cells=(8, 8, 4), reconstruction=1.0, dropout=0.0)
    scheme.expect_loss(loss)
    batches = scheme.training_set(drive(), 0)
    parameters = [*method.parameters(), *loss.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=1e-2)
    losses = []
    for k in range(40):
        step = scheme.step(method, loss, batches[k])
        optimizer.zero_grad()
        step.loss.backward()
        optimizer.step()
        losses.append(step.parts["identity"].item())
    assert np.mean(losses[-5:]) < 0.5 * math.log(5) < np.mean(losses[:5])


def test_what_does_not_fit_together_is_refused():
    with pytest.raises(ConfigError, match=r"loss\.identities: 10, expected at least"):
        SCHEME.expect_loss(SegmentIdentity(10))
    with pytest.raises(ConfigError, match="Contrastive, expected a subclass of SegmentLoss"):
        SCHEME.expect_loss(Contrastive())
    with pytest.raises(ConfigError, match="the method takes a PolarRaster"):
        SCHEME.training_set(some_scans(), 0)
    method = Locus(LocusSettings(raster_settings(RASTER), (2, 2, 2), hidden=4, feature=4))
    for values, name in (
        ({"feature": 5, "cells": (8, 8, 4)}, r"loss\.feature: 5, expected method\.feature=4"),
        ({"feature": 4, "cells": (8, 8, 8)}, r"loss\.cells: \[8, 8, 8\], expected"),
    ):
        with pytest.raises(ConfigError, match=name):
            SCHEME.expect_method(method, SegmentIdentity(20, **values))
        assert all(module.training for module in method.modules())
    for values, name in (({"size": 1}, "size"), ({"views": 1}, "views"), ({"cut": 1.5}, "cut")):
        with pytest.raises(ConfigError, match=rf"sampling\.{name}"):
            SegmentScheme(**values)
