"""Poses by rows of sinograms: of scenes seen twice; rows that do not fit are outvoted."""

import math

import numpy as np
import pytest
import torch
from scenes import scattered
from test_alignment import image, seen_from, wrapped

from deepring.core.radon import radon
from deepring.core.row_alignment import _fit, align_rows
from deepring.errors import DeepringError


@pytest.mark.parametrize("seed", range(4))
def test_the_pose_that_the_scan_was_seen_from_is_found(seed):
    x, y, heading = 5.0 - seed, 3.0 * seed - 4, math.radians(30 * seed - 60)
    points = scattered(seed)
    query = radon(image(seen_from(points, x, y, heading)))
    tried = torch.tensor([[-heading, -heading + math.pi]])
    found = align_rows(query, radon(image(points))[None], tried)
    assert abs(wrapped(float(found.yaw) + heading)) < 1e-3
    assert np.hypot(*(found.position[0].numpy() - [x, y])) < 1.0
    assert 0.1 < found.score.item() <= 1
    other = align_rows(query, radon(image(scattered(seed + 9)))[None], tried)
    assert other.score.item() < found.score.item()


def test_rows_that_do_not_fit_are_outvoted():
    theta = torch.arange(120) * (2 * math.pi / 120)
    directions = torch.stack([theta.cos(), theta.sin()], dim=-1)
    shifts = directions @ torch.tensor([7.0, -11.0])
    generator = torch.Generator().manual_seed(0)
    wrong = torch.randperm(120, generator=generator)[:48]
    shifts[wrong] = 60 * torch.rand(48, generator=generator)
    plain = torch.linalg.lstsq(directions, shifts[:, None]).solution[:, 0]
    assert torch.allclose(_fit(shifts, directions), torch.tensor([7.0, -11.0]), atol=0.2)
    assert (plain - torch.tensor([7.0, -11.0])).norm() > 2


def test_sizes_that_differ_are_refused():
    with pytest.raises(DeepringError, match=r"maps: shape \(1, 60, 120\)"):
        align_rows(torch.zeros(120, 120), torch.zeros(1, 60, 120), torch.zeros(1, 1))
