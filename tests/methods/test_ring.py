"""RING: scores near one after a turn and a translation, turn modulo π, symmetric scores."""

import math

import numpy as np
import pytest
import torch

from deepring.core.radon import radon
from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.methods.method import Method
from deepring.methods.ring import Ring
from deepring.rasters import BevRaster
from deepring.rasters.bev import bev_occupancy
from helpers.scenes import scattered

STEP = 2 * math.pi / 120


def describe(*clouds):
    # Without the ground removal: the scenes have none, and it works on a grid that does not turn.
    images = np.stack([bev_occupancy(points) for points in clouds])
    return Ring().describe(torch.from_numpy(images))


def moved(points, x=0.0, y=0.0, turn=0.0):
    return turn_points(points + np.array([x, y, 0.0], dtype=np.float32), turn)


def away_from(turn, period):
    """The distance of an angle from the nearest multiple of a period."""
    return abs((turn + period / 2) % period - period / 2)


def test_it_is_a_method():
    assert isinstance(Ring(), Method)
    assert Ring().raster == BevRaster()
    assert describe(scattered(0)).shape == (1, 120, 61)


def test_a_scan_scores_one_with_itself_and_less_with_others():
    places = describe(*(scattered(seed) for seed in range(5)))
    score, _ = Ring().compare(places, places)
    assert torch.allclose(score.diagonal(), torch.ones(5), atol=1e-5)
    others = score[~torch.eye(5, dtype=torch.bool)]
    assert others.max() < 0.99
    assert others.min() >= -1


def test_a_turn_by_one_step_keeps_the_score_near_one():
    scores = []
    for seed in range(4):
        points = scattered(seed)
        scores.append(Ring().compare(describe(moved(points, turn=STEP)), describe(points)).score)
    print(f"turned by one step: {[round(s.item(), 4) for s in scores]}")
    assert min(scores) > 0.98


@pytest.mark.parametrize(("x", "y"), [(4.0, 0.0), (-3.0, 5.0), (0.0, -8.0)])
def test_a_translation_keeps_the_score_near_one(x, y):
    points = scattered(1, radius=40.0)
    places = describe(points, *(scattered(seed) for seed in range(2, 8)))
    score, _ = Ring().compare(describe(moved(points, x, y)), places)
    print(f"moved by {x}, {y} m: {score[0, 0]:.3f}, others at most {score[0, 1:].max():.3f}")
    assert score[0, 0] > 0.97
    assert score.argmax() == 0
    # On the sinogram itself, without its spectrum, a translation costs more.
    raw = [radon(torch.from_numpy(bev_occupancy(p))) for p in (points, moved(points, x, y))]
    assert torch.nn.functional.cosine_similarity(*(r.flatten() for r in raw), dim=0) < score[0, 0]


@pytest.mark.parametrize("steps", [1, 10, 22, 45, 59])
def test_the_yaw_is_the_turn_of_the_points_modulo_half_a_turn(steps):
    points = scattered(2)
    turned = moved(points, 2.0, -1.0, turn=steps * STEP)
    turn = Ring().compare(describe(turned), describe(points)).turn.item()
    assert away_from(turn - steps * STEP, math.pi) < 1.01 * STEP
    if steps not in (1, 59):  # those are near a multiple of π, where a mirrored sign hides
        assert away_from(turn + steps * STEP, math.pi) > 3 * STEP


def test_half_a_turn_cannot_be_told():
    points = scattered(3)
    turned = moved(points, turn=math.pi)
    score, turn = Ring().compare(describe(turned), describe(points))
    assert score > 0.999
    assert away_from(turn.item(), math.pi) < 1e-3


def test_scores_are_symmetric_and_yaws_change_sign():
    one, other = describe(*(scattered(s) for s in range(3))), describe(scattered(7), scattered(8))
    forth, back = Ring().compare(one, other), Ring().compare(other, one)
    assert torch.allclose(forth.score, back.score.T, atol=1e-5)
    sums = forth.turn + back.turn.T
    assert all(away_from(turn, math.pi) < 1e-4 for turn in sums.flatten().tolist())


def test_a_dense_place_does_not_win_every_query():
    places = [scattered(seed, n=3000 if seed else 16000) for seed in range(5)]
    descriptors = describe(*places)
    assert torch.equal(Ring().compare(descriptors, descriptors).score.argmax(1), torch.arange(5))
    raw = torch.fft.rfft(radon(torch.from_numpy(np.stack([bev_occupancy(p) for p in places]))))
    plain = torch.einsum("qaw,daw->qd", raw.abs(), raw.abs())
    assert (plain.argmax(1) == 0).all()


def test_an_empty_scan_scores_zero():
    empty = np.zeros((0, 3), dtype=np.float32)
    score, _ = Ring().compare(describe(empty), describe(scattered(0), empty))
    assert torch.allclose(score, torch.zeros(1, 2), atol=1e-6)


def test_angles_and_bins_are_its_own():
    ring = Ring(BevRaster(cells=40), angles=48, bins=30)
    assert ring.raster.shape == (40, 40)
    assert ring.describe(torch.ones(2, 40, 40)).shape == (2, 48, 16)


def test_the_published_correlation_scores_in_zero_to_one():
    empty = np.zeros((0, 3), dtype=np.float32)
    places = describe(*(scattered(seed) for seed in range(5)), empty)
    paper = Ring().compare(places, places).score
    published = Ring(correlation="published").compare(places, places).score
    expected = torch.tensor([1.0] * 5 + [0.0])
    assert torch.allclose(published.diagonal(), expected, atol=1e-5)
    assert published.min() >= 0
    assert published.max() < 1 + 1e-5
    # Frequencies that are opposed count for a match: other places look more alike, if by little.
    others = ~torch.eye(6, dtype=torch.bool)
    others[5] = others[:, 5] = False
    more = (published - paper)[others]
    print(f"others score {paper[others].mean():.4f}, as published {more.mean():.4f} more")
    assert more.min() > -1e-5
    assert more.max() > 1e-3
    assert torch.equal(published[:5, :5].argmax(1), torch.arange(5))


@pytest.mark.parametrize("steps", [10, 22, 45])
def test_the_published_correlation_has_the_same_yaw(steps):
    points = scattered(2)
    places = describe(moved(points, 2.0, -1.0, turn=steps * STEP)), describe(points)
    turn = Ring(correlation="published").compare(*places).turn.item()
    assert away_from(turn - steps * STEP, math.pi) < 1.01 * STEP
    assert away_from(turn + steps * STEP, math.pi) > 3 * STEP


def test_another_correlation_is_named():
    with pytest.raises(DeepringError, match=r"RING: correlation: 'Eq. 8', expected one of paper"):
        Ring(correlation="Eq. 8")
