"""The pose scheme: pairs of two passes, moved at random, with their transform; its loss."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, pose_from, rotation_from_rpy
from deepring.data.packed_rasters import Rasters, pack
from deepring.errors import ConfigError, DataError
from deepring.methods.lcdnet import LcdNet, LcdNetSettings
from deepring.methods.lcdnet.pose_head import Matches
from deepring.rasters import Preprocessing, VoxelMeansRaster, raster_settings
from deepring.training.pairs import Contrastive
from deepring.training.poses import PosePairs, PoseScheme, TripletWithPose
from deepring.training.training_scans import TrainingScans
from helpers.training_scans import some_scans

#: The world lies within 20 m of each scan, and scans reach to 60 m: moving loses no point.
RASTER = VoxelMeansRaster(200, 24, 2.0, 60.0, Preprocessing(height=(-28.0, 20.0), clearance=None))


def two_passes(places=6, apart=40.0):
    """Scans of two sessions at places in a line, 3 m beside each other, each of 60 points."""
    rng = np.random.default_rng(0)
    worlds = rng.uniform([-15, -15, -3], [15, 15, 3], (places, 60, 3))
    images, frames = [], []
    for session in (0, 1):
        for k, world in enumerate(worlds):
            angles = [*rng.uniform(-0.02, 0.02, 2), rng.uniform(-3, 3)]
            frame = pose_from(rotation_from_rpy(*angles), [apart * k, 3.0 * session, 0.3])
            frames.append(frame)
            there = world + np.array([apart * k, 0, 0])
            seen = moved_points(there, np.linalg.inv(frame)).astype(np.float32)
            images.append(pack(RASTER(seen, 0.0), RASTER))
    frames = np.stack(frames)
    number = np.repeat([0, 1], places)
    return TrainingScans(
        frames[:, :2, 3],
        np.zeros_like(number),
        np.zeros(2 * places),
        Rasters(np.stack(images), RASTER),
        number,
        frames,
    )


def points_of(raster):
    points, filled = RASTER.in_metres(raster[None])
    return points[0][filled[0]][:, :3].numpy()


def test_the_transforms_carry_the_partners_points_onto_those_of_the_first_scans():
    scans = two_passes()
    made = PoseScheme(pairs=4).training_set(scans, seed=0)
    for index in range(3):
        batch = made[index]
        assert batch.rasters.shape == (8, 200, 4)
        for first, second, transform in zip(
            batch.rasters[:4], batch.rasters[4:], batch.transforms.numpy(), strict=True
        ):
            here, there = points_of(first), points_of(second)
            distances = np.linalg.norm(here[:, None] - moved_points(there, transform), axis=-1)
            # Most voxels hold one point alone, the same in both scans.
            assert np.median(distances.min(axis=0)) < 0.01
            wrong = moved_points(there, np.linalg.inv(transform))
            assert np.median(np.linalg.norm(here[:, None] - wrong, axis=-1).min(axis=0)) > 1.0


def test_pairs_are_of_two_sessions_and_negatives_of_other_places():
    made = PoseScheme(pairs=4).training_set(two_passes(), seed=1)
    assert [list(near) for near in made.partners] == [[k + 6] for k in range(6)] + [
        [k] for k in range(6)
    ]
    batch = made[0]
    same = ~batch.negatives
    own = torch.arange(4)
    assert same[own, own].all()
    assert same[own, own + 4].all()
    assert batch.lots.shape == (4, 8)


def test_scans_of_one_pass_are_no_pair():
    """A drive of 5 m from west to east, and from west to east again."""
    scans = two_passes(places=6, apart=1.0)
    x = np.tile(np.arange(6.0), 2)
    scans = dataclasses.replace(
        scans, positions=np.column_stack([x, 0 * x]), session=np.zeros_like(scans.session)
    )
    path = np.concatenate([np.arange(6.0), 10 + np.arange(6.0)])
    made = PoseScheme(pairs=2, positive_radius=2.0, pass_apart=9.5).training_set(scans, seed=0)
    for k, near in enumerate(made.partners):
        expected = (np.abs(x - x[k]) <= 2) & (np.abs(path - path[k]) > 9.5)
        assert near.tolist() == np.flatnonzero(expected).tolist()
    assert made.partners[0].tolist() == [6, 7, 8]
    assert made.partners[4].tolist() == [10, 11]
    with pytest.raises(DataError, match=r"sampling.pairs: 2, but only 0 of 12.*pass_apart"):
        PoseScheme(pairs=2, pass_apart=50.0).training_set(scans, seed=0)


def test_batches_are_the_same_again_and_scans_are_moved_as_far_as_the_settings_say():
    scans = two_passes()
    scheme = PoseScheme(pairs=4, turn=20.0, tilt=2.0, shift=1.0, lift=0.2)
    made = scheme.training_set(scans, seed=3)
    again = scheme.training_set(scans, seed=3)[5]
    for ours, theirs in zip(made[5], again, strict=True):
        assert torch.equal(ours, theirs)
    assert not torch.equal(made[6].rasters, again.rasters)
    moves = made.moves(500, np.random.default_rng(0))
    turns = np.degrees(np.arctan2(moves[:, 1, 0], moves[:, 0, 0]))
    assert 19 < np.abs(turns).max() <= 20
    assert (np.abs(moves[:, :3, 3]).max(axis=0) <= [1.0, 1.0, 0.2]).all()
    assert (np.abs(moves[:, :3, 3]).max(axis=0) >= [0.95, 0.95, 0.19]).all()
    tilts = np.degrees(np.arcsin(-moves[:, 2, 0]))
    assert 1.9 < np.abs(tilts).max() <= 2.0
    still = PoseScheme(pairs=4, turn=0, tilt=0, shift=0, lift=0).training_set(scans, seed=3)
    assert np.array_equal(still.moves(3, np.random.default_rng(0)), np.tile(np.eye(4), (3, 1, 1)))


def pairs_of(own, others, negatives, lots, error=0.0, missed=0.0):
    """One pair whose partner is ``own`` away, and other pairs at these distances."""
    n = len(others) // 2 + 1
    first = torch.zeros(1, 2)
    vectors = torch.tensor([[d, 0.0] for d in others])
    half = len(others) // 2
    stacked = torch.cat([first, vectors[:half], torch.tensor([[0.0, own]]), vectors[half:]])
    points = torch.tensor([[1.0, 0, 0], [0, 2, 0]]).repeat(n, 1, 1)
    true = torch.eye(4, dtype=torch.float64).repeat(n, 1, 1)
    found = true.clone()
    found[:, 0, 3] = error
    matches = Matches(
        points, points + torch.tensor([0, missed, 0]), torch.ones(n, 2), found, torch.ones(n) > 0
    )
    return PosePairs(stacked, negatives, lots, matches, true)


def test_the_triplet_draws_one_of_the_negatives_that_violate():
    negatives = torch.zeros(2, 4, dtype=torch.bool)
    negatives[0, [1, 3]] = True  # the other pair, 0.6 and 2 away
    for lots, term in (([0, 0.9, 0, 0.1], 0.1), ([0, 0.1, 0, 0.9], 0.1)):
        pairs = pairs_of(0.2, [0.6, 2.0], negatives, torch.tensor([lots, [0.0] * 4]))
        step = TripletWithPose()(pairs)
        # 2 away violates nothing, whatever its lot; the second pair has no negative.
        assert float(step.parts["triplet"]) == pytest.approx(0.5 + 0.2 - 0.6, abs=1e-5)
        assert float(step.parts["triplet"]) == pytest.approx(term, abs=1e-5)
        assert float(step.parts["active"]) == 0.5
    near = pairs_of(0.2, [0.3, 0.5], negatives, torch.tensor([[0, 0.1, 0, 0.9], [0.0] * 4]))
    assert float(TripletWithPose()(near).parts["triplet"]) == pytest.approx(0.2, abs=1e-5)
    far = pairs_of(0.2, [1.0, 2.0], negatives, torch.rand(2, 4))
    step = TripletWithPose()(far)
    assert float(step.parts["triplet"]) == float(step.parts["active"]) == 0.0
    assert float(step.accuracy) == 1.0


def test_the_pose_counts_by_where_it_puts_the_points():
    none, lots = torch.zeros(2, 4, dtype=torch.bool), torch.zeros(2, 4)
    pairs = pairs_of(0.2, [0.6, 2.0], none, lots, error=3.0, missed=4.0)
    step = TripletWithPose()(pairs)
    assert float(step.loss) == pytest.approx(3.0 + 0.05 * 4.0)
    assert float(TripletWithPose(pose_weight=0.5, match_weight=0)(pairs).loss) == pytest.approx(1.5)
    turned = pairs.transforms.clone()
    turned[:, :2, :2] = torch.tensor([[0.0, -1], [1, 0]])
    found = pairs.matches._replace(transforms=turned)
    step = TripletWithPose()(pairs._replace(matches=found))
    # (1, 0, 0) is put at (0, 1, 0), and (0, 2, 0) at (-2, 0, 0).
    assert float(step.parts["pose"]) == pytest.approx((math.sqrt(2) + 2 * math.sqrt(2)) / 2)


def test_a_few_steps_lower_the_loss_and_reach_every_weight():
    torch.manual_seed(0)
    values = {"features": 16, "clusters": 4, "dimension": 8, "momentum": 0.1}
    network = LcdNet(LcdNetSettings(raster_settings(RASTER), widths=(2, 2, 4, 4, 4), **values))
    scheme, loss = PoseScheme(pairs=3, tilt=0.0), TripletWithPose()
    batch = scheme.training_set(two_passes(), seed=0)[0]
    optimizer = torch.optim.Adam(network.parameters(), 0.02)
    losses = []
    for _ in range(8):
        step = scheme.step(network, loss, batch)
        optimizer.zero_grad()
        step.loss.backward()
        assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())
        optimizer.step()
        losses.append(float(step.loss.detach()))
    assert losses[-1] < 0.9 * losses[0]


def test_what_does_not_fit_is_refused():
    with pytest.raises(ConfigError, match=r"sampling: PoseScheme, .* takes a PolarRaster.*points"):
        PoseScheme().training_set(some_scans(), seed=0)
    scans = two_passes()
    without = dataclasses.replace(scans, frames=None)
    with pytest.raises(DataError, match="scans: without frames"):
        PoseScheme().training_set(without, seed=0)
    with pytest.raises(ConfigError, match="expected a subclass of PoseLoss"):
        PoseScheme().expect_loss(Contrastive())
    for name, value in (("turn", 200.0), ("shift", -1.0), ("pairs", 1), ("pass_apart", -1.0)):
        with pytest.raises(ConfigError, match=rf"sampling\.{name}: "):
            PoseScheme(**{name: value})
