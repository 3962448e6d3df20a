"""Relative poses of images of one scene; conventions with their misreadings; direct sums."""

import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.localization.alignment import align
from deepring.localization.alignment.image_correlation import (
    correlations,
    half_whitened,
    occupied_cells,
    turned_images,
)
from deepring.localization.alignment.settings import AlignmentSettings
from deepring.rasters.bev import bev_occupancy
from helpers.scenes import scattered

SETTINGS = AlignmentSettings()


def image(points):
    return torch.from_numpy(bev_occupancy(points))


def seen_from(points, x, y, heading):
    """The points in the frame of a sensor at (x, y) that looks along ``heading``."""
    c, s = math.cos(heading), math.sin(heading)
    moved = points - np.array([x, y, 0], np.float32)
    turned = np.column_stack(
        [c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0], moved[:, 2]]
    )
    return turned.astype(np.float32)


def spectra(*clouds):
    return half_whitened(torch.stack([image(cloud) for cloud in clouds]), SETTINGS)


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


@settings(derandomize=True, max_examples=12, deadline=None)
@given(
    st.integers(0, 9),
    st.floats(-15, 15),
    st.floats(-15, 15),
    st.floats(-math.pi, math.pi),
    st.floats(-3, 3),
)
def test_the_pose_that_the_scan_was_seen_from_is_found(seed, x, y, heading, off):
    points = scattered(seed)
    cells = occupied_cells(image(seen_from(points, x, y, heading)), SETTINGS)
    # The points turn the other way than the sensor; turns are known to a few degrees.
    tried = torch.tensor([[-heading + math.radians(off), -heading + math.pi]])
    found = align(cells, spectra(points), tried, SETTINGS)
    assert abs(wrapped(float(found.turn) + heading)) < math.radians(1.6)
    assert np.hypot(*(found.position[0].numpy() - [x, y])) < 0.8
    # Misreadings: the turn of the sensor, and the map's sensor in the frame of the query.
    there = found.position[0].numpy()
    if abs(wrapped(2 * heading)) > 0.2:
        assert abs(wrapped(float(found.turn) - heading)) > math.radians(5)
        c, s = math.cos(heading), math.sin(heading)
        inverse = np.array([-c * x - s * y, s * x - c * y])
        if np.hypot(*(inverse - [x, y])) > 3:
            assert np.hypot(*(there - inverse)) > 1.5


def test_other_scenes_score_less():
    points = scattered(0)
    cells = occupied_cells(image(seen_from(points, 6.0, -4.0, 0.7)), SETTINGS)
    others = [scattered(seed) for seed in range(1, 8)]
    tried = torch.tensor([[-0.7, -0.7 + math.pi]]).expand(8, -1)
    found = align(cells, spectra(points, *others), tried, SETTINGS)
    assert int(found.score.argmax()) == 0
    assert found.score[0] > 2 * found.score[1:].max()
    assert found.score.max() <= 1


def test_a_scan_fits_itself_perfectly():
    points = scattered(3)
    cells = occupied_cells(image(points), SETTINGS)
    found = align(cells, spectra(points), torch.tensor([[0.0]]), SETTINGS)
    assert found.score.item() == pytest.approx(1.0, abs=1e-3)
    assert found.turn.item() == pytest.approx(0.0, abs=1e-3)
    assert found.position.abs().max() < 1e-2


def test_the_correlation_is_the_direct_sum_over_shifts():
    small = AlignmentSettings(cells=12, extent=6.0, padded=16, reach=3.0, blur=0.5)
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(2, 12, 12, generator=generator).double() < 0.2
    whole = [torch.fft.irfft2(s, s=(16, 16)) * 16 for s in half_whitened(images, small)]
    assert float(whole[0].square().sum()) == pytest.approx(1.0, abs=1e-5)
    cells = occupied_cells(images[1], small)
    turned = half_whitened(turned_images(cells, torch.zeros(1), small), small)
    pair = torch.tensor([[0, 0, 0]])
    curves = correlations(half_whitened(images[:1], small), turned, pair, small)[0]
    assert curves.shape == (16, 16)
    for i, j in itertools.product(range(-3, 4), repeat=2):
        direct = float((whole[0] * whole[1].roll((i, j), dims=(0, 1))).sum())
        assert float(curves[i, j]) == pytest.approx(direct, abs=1e-5)


def test_turning_moves_every_cell_where_trigonometry_says():
    cells = torch.tensor([[20.0, 5.0], [-31.0, 40.0]])
    quarter = turned_images(cells, torch.tensor([math.pi / 2]), SETTINGS)[0]
    # Turned back by a quarter: (x, y) -> (y, -x).
    expected = turned_images(torch.tensor([[5.0, -20.0], [40.0, 31.0]]), torch.zeros(1), SETTINGS)
    assert torch.allclose(quarter, expected[0], atol=1e-3)
    assert quarter.sum().item() == pytest.approx(2.0, abs=1e-4)
    outside = turned_images(torch.tensor([[69.0, 69.0]]), torch.tensor([math.pi / 4]), SETTINGS)
    assert outside.sum() == 0


def test_empty_images_fit_nothing_and_fail_nothing():
    empty = torch.zeros(1, 120, 120, dtype=torch.bool)
    found = align(
        occupied_cells(empty[0], SETTINGS),
        half_whitened(empty, SETTINGS),
        torch.tensor([[0.0]]),
        SETTINGS,
    )
    assert found.score.item() == 0
    assert torch.isfinite(found.position).all()


def test_mistakes_are_named():
    with pytest.raises(DeepringError, match=r"alignment\.padded: 100"):
        AlignmentSettings(padded=100)
    with pytest.raises(DeepringError, match=r"alignment\.blur: 0"):
        AlignmentSettings(blur=0)
    with pytest.raises(DeepringError, match=r"image: shape \(3, 3\)"):
        occupied_cells(torch.zeros(3, 3), SETTINGS)
