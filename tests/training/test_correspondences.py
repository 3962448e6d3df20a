"""Pairs of scans with a known pose: the losses by hand, the pose that brings points together."""

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, turn_points
from deepring.data.packed_rasters import Rasters, pack
from deepring.errors import ConfigError, DataError
from deepring.rasters import PointsRaster, Preprocessing
from deepring.testing import walls
from deepring.training.correspondences import (
    Correspondences,
    CorrespondenceScheme,
    NTuple,
    Reliability,
)
from deepring.training.training_scans import TrainingScans
from helpers.tiny_methods import TINY
from helpers.training_scans import some_scans

RASTER = PointsRaster(64, preprocessing=Preprocessing(clearance=None))


def pairs(distances, metres, scores=None, around=None):
    m = len(metres)
    scores = torch.full((m,), 0.5) if scores is None else torch.tensor(scores)
    around = torch.arange(m)[:, None] if around is None else torch.tensor(around)
    return Correspondences(
        torch.tensor(distances)[None], torch.tensor(metres)[None], scores[None], around[None]
    )


def test_n_tuples_by_hand():
    distances = [[0.2, 0.4, 0.9], [0.7, 1.5, 0.3], [1.0, 0.6, 0.8]]
    metres = [[0.1, 3.0, 30.0], [0.7, 0.2, 2.0], [5.0, 9.0, 4.0]]
    step = NTuple()(pairs(distances, metres))
    pull = (0.2 + 1.5) / 2  # the third has no counterpart
    push = (0.6 + 0.7 + 0.0 + 0.4 + 0.2) / 5  # 0.7 m is neither, 30 m is too far
    assert step.loss.item() == pytest.approx(pull + 5 * push)
    assert step.parts["push"].item() == pytest.approx(push)
    assert step.accuracy.item() == pytest.approx(0.5)  # the first is found, the second is not
    assert NTuple(weight=0)(pairs(distances, metres)).loss.item() == pytest.approx(pull)
    alone = NTuple()(pairs([[0.3]], [[7.0]]))  # nothing in common
    assert alone.loss.item() == pytest.approx(5 * 0.7)


def test_a_score_pays_where_descriptors_succeed():
    distances = [[0.1, 0.9, 0.9], [0.9, 0.1, 0.9], [0.1, 0.9, 0.9]]
    metres = [[0.1, 9.0, 9.0], [9.0, 0.1, 9.0], [9.0, 9.0, 0.1]]  # the third is mistaken
    around = [[0, 1], [1, 0], [2, 1]]
    scores = [0.9, 0.5, 0.2]
    step = Reliability(threshold=0.3)(pairs(distances, metres, scores, around))
    success = [1.0, 1.0, 0.5]
    terms = [1 - (0.3 * (1 - s) + s * r) for s, r in zip(scores, success, strict=True)]
    assert step.loss.item() == pytest.approx(np.mean(terms))
    assert step.parts["matched"].item() == pytest.approx(2 / 3)
    assert step.parts["kept"].item() == pytest.approx((0.9 + 0.5) / 1.6)
    # Beyond the threshold a higher score lowers the loss, below it raises it.
    scores = torch.tensor([[0.5, 0.5, 0.5]], requires_grad=True)
    batch = pairs(distances, metres, around=[[0, 1], [1, 0], [2, 2]])._replace(scores=scores)
    Reliability(threshold=0.3)(batch).loss.backward()
    assert (scores.grad < 0).tolist() == [[True, True, False]]


def scans_of_one_world():
    """A world of walls, seen from places 3 m apart, each with a heading of its own."""
    world, rasters, headings = walls(1), [], [0.0, 2.0, -1.2]
    positions = np.array([[0.0, 0.0], [3.0, 1.0], [5.0, -1.0]])
    for (x, y), heading in zip(positions, headings, strict=True):
        seen = turn_points(world - np.float32([x, y, 0.0]), -heading)
        rasters.append(pack((seen[:64] / RASTER.extent).astype(np.float16), RASTER))
    images = np.stack(rasters)
    none = np.zeros(3, dtype=np.int64)
    return TrainingScans(positions, none, np.array(headings), Rasters(images, RASTER), none)


@pytest.mark.parametrize("partners", ["copies", "scans"])
def test_the_transform_carries_the_partners_points_onto_the_first_scans(partners):
    scheme = CorrespondenceScheme(pairs=3, points=16, around=4, jitter=0.0, partners=partners)
    data = scheme.training_set(scans_of_one_world(), seed=4)
    batch = data[0]
    assert batch.rasters.shape == (6, 64, 3)
    first, second = (half.numpy() * RASTER.extent for half in batch.rasters.chunk(2))
    for k in range(3):
        carried = moved_points(second[k], batch.transforms[k].numpy().astype(np.float64))
        off = np.abs(carried - first[k]).max()
        assert off < 0.1  # of half precision
        opposite = np.linalg.inv(batch.transforms[k].numpy().astype(np.float64))
        assert np.abs(moved_points(second[k], opposite) - first[k]).max() > 1.0
    tilts = batch.transforms[:, 2, 2]
    assert (tilts > np.cos(2 * np.hypot(0.18, 0.18))).all()
    assert torch.equal(data[0].rasters, batch.rasters)
    assert not torch.equal(data[1].rasters, batch.rasters)


def test_jitter_is_bounded():
    plain, noisy = (
        CorrespondenceScheme(pairs=4, points=16, around=4, jitter=jitter, tilt=0.0)
        .training_set(scans_of_one_world(), seed=4)[0]
        .rasters
        for jitter in (0.0, 0.05)
    )
    # Lengths are those of the points before the turn.
    moved = (plain.norm(dim=-1) - noisy.norm(dim=-1)).abs().max() * RASTER.extent
    assert 0.0 < float(moved) < 0.1 * 3**0.5 + 1e-3


def test_a_step_trains_local_descriptors_and_another_the_detector():
    scheme = CorrespondenceScheme(pairs=2, points=32, around=4)
    batch = scheme.training_set(scans_of_one_world(), seed=0)[0]
    for loss, learns, rests in (
        (NTuple(radius=2.0, apart=3.0), "local", "detector"),
        (Reliability(radius=2.0), "detector", "place"),
    ):
        network = TINY["dh3d"]().train()
        step = scheme.step(network, loss, batch)
        assert step.loss.isfinite()
        assert 0 <= step.accuracy <= 1
        step.loss.backward()
        assert all(w.grad.isfinite().all() for w in getattr(network, learns).parameters())
        assert any(w.grad.abs().sum() > 0 for w in getattr(network, learns).parameters())
        assert all(w.grad is None for w in getattr(network, rests).parameters())


def test_what_does_not_go_together_is_refused():
    scheme = CorrespondenceScheme(pairs=2, points=32, around=4)
    with pytest.raises(ConfigError, match=r"expected a method of points, not of PolarRaster"):
        scheme.training_set(some_scans(), seed=0)
    with pytest.raises(ConfigError, match=r"sampling\.points: 512, expected at most the 64"):
        CorrespondenceScheme().training_set(scans_of_one_world(), seed=0)
    far = scans_of_one_world()
    alone = CorrespondenceScheme(points=32, partners="scans", place_radius=0.5)
    with pytest.raises(DataError, match=r"sampling\.place_radius: none of 3 training scans"):
        alone.training_set(far, seed=0)
    with pytest.raises(ConfigError, match=r"sampling\.points: 512, expected at most the 64"):
        CorrespondenceScheme().expect_method(TINY["dh3d"](), NTuple())
    for changes, complaint in (
        ({"points": 4}, r"sampling\.points: 4"),
        ({"partners": "both"}, r"sampling\.partners: 'both', expected one of copies, scans"),
        ({"tilt": -1.0}, r"sampling\.tilt: -1"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            CorrespondenceScheme(**changes)
    with pytest.raises(ConfigError, match=r"loss\.apart: 0\.2"):
        NTuple(apart=0.2)
