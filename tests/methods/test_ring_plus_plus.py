"""RING++: turns roll the descriptor, translations hardly change it, the turn modulo π."""

import math

import numpy as np
import pytest
import torch

from deepring.core.equivariance import relative_error
from deepring.core.radon import radon
from deepring.core.rigid import turn_points
from deepring.core.spectrum import row_dft_magnitude, standardise_spectrum
from deepring.errors import DeepringError
from deepring.methods.method import Method
from deepring.methods.ring_plus_plus import RingPlusPlus
from deepring.rasters import BevRaster, FeatureBevRaster, Preprocessing
from helpers.scenes import scattered

STEP = 2 * math.pi / 120
# Without the ground removal: the scenes have none, and it works on a grid that does not turn.
RASTER = FeatureBevRaster(preprocessing=Preprocessing(height=(-5.0, 20.0), clearance=None))


def describe(*clouds):
    images = np.stack([RASTER(points, 0.0) for points in clouds])
    return RingPlusPlus(RASTER).describe(torch.from_numpy(images))


def moved(points, x=0.0, y=0.0, turn=0.0):
    return turn_points(points + np.array([x, y, 0.0], dtype=np.float32), turn)


def away_from(turn, period):
    """The distance of an angle from the nearest multiple of a period."""
    return abs((turn + period / 2) % period - period / 2)


@pytest.fixture(scope="module")
def places():
    return describe(*(scattered(seed, radius=40.0) for seed in range(5)))


def test_it_is_a_method(places):
    assert isinstance(RingPlusPlus(), Method)
    assert RingPlusPlus().raster == FeatureBevRaster()
    assert places.shape == (5, 120, 6 * 61)


def test_each_channel_is_described_by_itself():
    images = torch.rand(2, 6, 30, 30, generator=torch.Generator().manual_seed(0))
    found = RingPlusPlus(FeatureBevRaster(cells=30), angles=24, bins=30).describe(images)
    for channel in range(6):
        alone = standardise_spectrum(row_dft_magnitude(radon(images[:, channel], 24, 30)), 30)
        ours = found[..., channel * 16 : (channel + 1) * 16]
        assert torch.allclose(ours, alone, atol=1e-5)
        scaled = (
            images
            * torch.tensor([1000.0 if c == channel else 1.0 for c in range(6)])[:, None, None]
        )
        again = RingPlusPlus(FeatureBevRaster(cells=30), angles=24, bins=30).describe(scaled)
        assert torch.allclose(found, again, atol=1e-3)


@pytest.mark.parametrize("steps", [1, 22, 30, 45])
def test_a_turn_by_whole_steps_rolls_the_descriptor(steps, places):
    turned = describe(
        *(moved(scattered(seed, radius=40.0), turn=steps * STEP) for seed in range(5))
    )
    rolled = relative_error(turned, places.roll(steps, dims=1))
    back = relative_error(turned, places.roll(-steps, dims=1))
    others = relative_error(places.roll(1, dims=0), places)
    print(f"{steps} steps: rolled {rolled:.3f}, other way {back:.3f}, other places {others:.3f}")
    assert rolled < 0.1  # 0.08 measured: the grids of voxels and cells do not turn
    assert others > 0.2
    if steps != 30:  # half a turn apart, both ways are one
        assert back > 0.15


@pytest.mark.parametrize(("x", "y"), [(4.0, 0.0), (-3.0, 5.0), (0.0, -8.0)])
def test_a_translation_changes_the_descriptor_little(x, y, places):
    shifted = describe(*(moved(scattered(seed, radius=40.0), x, y) for seed in range(5)))
    error = relative_error(shifted, places)
    print(f"moved by {x}, {y} m: {error:.3f}")
    assert error < 0.1  # 0.08 measured, other places 0.26
    score, _ = RingPlusPlus(RASTER).compare(shifted, places)
    assert score.diagonal().min() > 0.99
    assert torch.equal(score.argmax(1), torch.arange(5))


@pytest.mark.parametrize("correlation", ["paper", "published"])
@pytest.mark.parametrize("steps", [10, 22, 45])
def test_it_finds_a_turned_scan_and_its_yaw_modulo_half_a_turn(steps, correlation, places):
    query = describe(moved(scattered(2, radius=40.0), 2.0, -1.0, turn=steps * STEP))
    score, turn = RingPlusPlus(RASTER, correlation=correlation).compare(query, places)
    assert score.argmax() == 2
    assert score.max() < 1 + 1e-5
    assert away_from(turn[0, 2].item() - steps * STEP, math.pi) < 1.01 * STEP
    assert away_from(turn[0, 2].item() + steps * STEP, math.pi) > 3 * STEP


@pytest.mark.parametrize("correlation", ["paper", "published"])
def test_a_scan_scores_one_with_itself_and_an_empty_one_zero(correlation, places):
    both = torch.cat([places, describe(np.zeros((0, 3), np.float32))])
    score, _ = RingPlusPlus(RASTER, correlation=correlation).compare(both, both)
    assert torch.allclose(score.diagonal(), torch.tensor([1.0] * 5 + [0.0]), atol=1e-5)
    assert torch.allclose(score[5], torch.zeros(6), atol=1e-6)
    assert score.min() >= -1
    assert score[:5, :5][~torch.eye(5, dtype=torch.bool)].max() < 0.99


def test_half_a_turn_cannot_be_told():
    points = scattered(3)
    score, turn = RingPlusPlus(RASTER).compare(
        describe(moved(points, turn=math.pi)), describe(points)
    )
    assert score > 0.99
    assert away_from(turn.item(), math.pi) < 1e-3


def test_what_does_not_fit_is_named():
    with pytest.raises(DeepringError, match=r"RING\+\+: raster: a BevRaster, expected a Fea"):
        RingPlusPlus(BevRaster())
    with pytest.raises(DeepringError, match=r"RING\+\+: correlation: 'both', expected"):
        RingPlusPlus(correlation="both")
