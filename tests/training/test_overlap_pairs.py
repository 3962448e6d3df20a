"""Pairs with their overlap and turn: which are drawn, what they are told, and the loss."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, planar_pose, turn_points
from deepring.data.packed_rasters import Rasters, pack
from deepring.errors import ConfigError, DataError
from deepring.rasters import RangeNormalRaster
from deepring.testing import walls
from deepring.training.pairs import OverlapAndTurn, OverlapPairs, OverlapScheme
from deepring.training.pairs.overlap_loss import turn_bins
from deepring.training.training_scans import TrainingScans
from helpers.tiny_methods import TINY
from helpers.training_scans import some_scans

RASTER = RangeNormalRaster(
    sectors=60, rows=12, elevation=(-25, 30), viewpoint=1.8, normals="radial"
)
TOGETHER = walls(3, radius=60.0)


def street(count=12, step=3.0):
    """Scans of one scene, ``step`` metres apart, with headings of whole sectors."""
    rng = np.random.default_rng(0)
    headings = rng.integers(60, size=count) * (2 * math.pi / 60)
    positions = np.column_stack([step * np.arange(count), np.zeros(count)])
    points = [
        moved_points(TOGETHER, np.linalg.inv(planar_pose(*at, heading))).astype(np.float32)
        for at, heading in zip(positions, headings, strict=True)
    ]
    images = np.stack([pack(RASTER(scan, 0.0), RASTER) for scan in points])
    zeros = np.zeros(count, dtype=np.int64)
    return TrainingScans(positions, zeros, headings, Rasters(images, RASTER), zeros)


def test_a_scan_overlaps_its_neighbour_more_than_a_far_one(monkeypatch):
    made = OverlapScheme(partners=11, radius=4.0).training_set(street(), seed=0)
    assert len(made.pairs) == len({tuple(pair) for pair in made.pairs.tolist()}) == 12 * 11
    away = np.abs(made.pairs[:, 0] - made.pairs[:, 1])
    near, far = made.overlaps[away == 1].mean(), made.overlaps[away >= 8].mean()
    assert near > 1.5 * far > 0
    # The usual misreading: the pose the other way round. Headings differ, and little overlaps.
    right = TrainingScans.level_pose
    wrong = lambda scans, first, second: np.linalg.inv(right(scans, first, second))  # noqa: E731
    monkeypatch.setattr(TrainingScans, "level_pose", wrong)
    assert made._overlaps()[away == 1].mean() < 0.8 * near


def test_half_of_the_partners_are_near_and_all_are_of_the_same_dataset():
    scans = some_scans(raster=RASTER)
    made = OverlapScheme(partners=4, radius=5.0).training_set(scans, seed=0)
    metres = np.abs(np.diff(scans.positions[made.pairs][..., 0], axis=1))[:, 0]
    assert np.bincount(made.pairs[:, 0]).tolist() == [4] * len(scans)
    assert np.bincount(made.pairs[:, 0], metres < 5).min() >= 2
    datasets = np.arange(len(scans)) % 2
    two = TrainingScans(scans.positions, datasets, scans.headings, scans.rasters, scans.session)
    pairs = OverlapScheme(partners=4).training_set(two, seed=0).pairs
    assert (datasets[pairs[:, 0]] == datasets[pairs[:, 1]]).all()


def test_batches_are_even_over_the_overlap_and_their_turns_are_of_the_points():
    scheme = OverlapScheme(pairs=40, partners=11, bins=8, around=0, turned=True)
    made = scheme.training_set(street(step=0.5), seed=1)
    part = np.concatenate([np.floor(made[k].overlap.numpy() * 8).clip(max=7) for k in range(10)])
    shares = [(part == k).mean() for k in range(8) if (made.overlaps * 8 // 1 == k).any()]
    assert len(shares) == len(made.parts) > 1
    assert max(shares) < 1.5 / len(shares)
    batch = made[3]
    assert torch.equal(batch.rasters, made[3].rasters)
    first, second = batch.rasters.chunk(2)
    # Rolled by the turn, what the partner sees comes to lie on what the first sees.
    bins = turn_bins(batch.turn, 60)
    alike = {}
    for sign in (1, -1):
        rolled = RASTER.turned(second, (sign * bins) % 60)[:, 0].float()
        apart = (rolled - first[:, 0].float()).abs()
        near = batch.overlap > 0.5
        both = ((apart < 1) & (first[:, 0] > 0)).sum(dim=(1, 2)) / (first[:, 0] > 0).sum((1, 2))
        alike[sign] = float(both[near].mean())
    assert alike[1] > 0.4 > 2 * alike[-1]


def test_the_published_loss_of_overlaps():
    error = torch.tensor([0.0, 0.1, 0.25, 0.5])
    for value, expected in zip(error, (0.01236, 0.13298, 2.5, 4.98764), strict=True):
        pairs = OverlapPairs(torch.zeros(1), torch.zeros(1, 4), 0.5 + value[None], torch.zeros(1))
        step = OverlapAndTurn(turn=0.0)(pairs)
        assert float(step.loss) == pytest.approx(expected, abs=1e-5)
        assert float(step.parts["error"]) == pytest.approx(float(value))


def test_turns_are_learnt_from_pairs_that_overlap():
    curves = torch.tensor([[0.0, 2.0, -1.0, 0.5], [1.0, 1.0, 1.0, 1.0], [5.0, 0.0, 0.0, 0.0]])
    overlap = torch.tensor([0.9, 0.2, 0.8])
    turn = torch.tensor([math.pi / 2, 0.0, -math.pi / 2 + 0.1])
    pairs = OverlapPairs(torch.zeros(3), curves, overlap, turn)

    def by_hand(curve, true):
        shares = 1 / (1 + np.exp(-np.array(curve)))
        terms = [4 * -np.log(s) if k == true else -np.log(1 - s) for k, s in enumerate(shares)]
        return np.mean(terms)

    expected = np.mean([by_hand([0, 2, -1, 0.5], 1), by_hand([5, 0, 0, 0], 3)])
    loss = OverlapAndTurn(overlap=0.0)
    assert float(loss(pairs).loss) == pytest.approx(expected, rel=1e-5)
    shifted = pairs._replace(curves=curves + 100)
    centred = OverlapAndTurn(overlap=0.0, centred=True)
    assert float(centred(shifted).loss) == pytest.approx(float(centred(pairs).loss), rel=1e-4)
    nothing = pairs._replace(overlap=torch.zeros(3))
    assert float(loss(nothing).loss) == 0.0


def test_a_network_learns_from_a_batch():
    torch.manual_seed(0)
    method = TINY["overlapnet"]()
    scheme = OverlapScheme(pairs=8, turned=True)
    made = scheme.training_set(overlapping(method.raster), seed=0)
    loss, optimizer = OverlapAndTurn(centred=True), torch.optim.Adam(method.parameters(), 3e-3)
    scheme.expect_loss(loss)
    losses = []
    for _ in range(30):
        step = scheme.step(method, loss, made[0])
        optimizer.zero_grad()
        step.loss.backward()
        optimizer.step()
        losses.append(step.loss.item())
    assert losses[-1] < 0.8 * losses[0]
    assert set(step.parts) == {"overlap", "turn", "error"}


def overlapping(raster):
    """The street in another raster."""
    scans = street()
    points = [
        moved_points(TOGETHER, np.linalg.inv(planar_pose(*at, heading))).astype(np.float32)
        for at, heading in zip(scans.positions, scans.headings, strict=True)
    ]
    images = np.stack([pack(raster(turn_points(scan, 0.0), 0.0), raster) for scan in points])
    return TrainingScans(
        scans.positions, scans.dataset, scans.headings, Rasters(images, raster), scans.session
    )


def test_what_does_not_fit_is_refused():
    with pytest.raises(ConfigError, match="a RangeNormalRaster, whose ranges overlap, got a Polar"):
        OverlapScheme().training_set(some_scans(), seed=0)
    scans = street(1)
    with pytest.raises(DataError, match="none of 1 training scans has another in its dataset"):
        OverlapScheme().training_set(scans, seed=0)
    for name, value in (("pairs", 0), ("partners", 0), ("radius", 0.0), ("tolerance", -1.0)):
        with pytest.raises(ConfigError, match=f"sampling.{name}: "):
            OverlapScheme(**{name: value})
    with pytest.raises(ConfigError, match=r"loss\.turn_from: 2"):
        OverlapAndTurn(turn_from=2)
