"""Distances by loops, close descriptors kept apart, and no rotation found."""

import numpy as np
import pytest
import torch

from deepring.core.correlation import circular_cross_correlation, unit_norm
from deepring.core.similarity import cosine, negative_distance


def maps(count, seed=0, shape=(12, 7)):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(count, *shape, generator=generator)


def test_both_agree_with_loops_over_pairs():
    q, d = maps(3), maps(5, seed=1)
    for i in range(3):
        for j in range(5):
            a, b = q[i].double().numpy().ravel(), d[j].double().numpy().ravel()
            distance = float(np.sqrt(((a - b) ** 2).sum()))
            angle = float(a @ b / np.sqrt((a @ a) * (b @ b)))
            assert negative_distance(q, d)[i, j].item() == pytest.approx(-distance, rel=1e-5)
            assert cosine(q, d)[i, j].item() == pytest.approx(angle, abs=1e-5)


def test_close_descriptors_are_told_apart():
    base = unit_norm(maps(1))
    step = 1e-4 * unit_norm(maps(1, seed=2))
    near = torch.cat([base, base + step, base + 2 * step] * 10)  # many rows: cdist would expand
    found = negative_distance(base.expand(30, -1, -1), near)[0, :3]
    assert torch.allclose(found, torch.tensor([0.0, -1e-4, -2e-4]), atol=2e-6)
    expanded = torch.cdist(base.flatten(1).expand(30, -1), near.flatten(1))[0, 1]
    assert abs(expanded.item() - 1e-4) > 1e-5


def test_neither_undoes_a_rotation_as_correlation_does():
    d = unit_norm(maps(1))
    turned = d.roll(4, dims=-2)
    assert circular_cross_correlation(turned, d).score.item() == pytest.approx(1, abs=1e-5)
    assert cosine(turned, d).item() < 0.5
    assert negative_distance(turned, d).item() < -0.5


def test_the_distance_of_a_descriptor_to_itself_has_a_finite_gradient():
    d = maps(2).requires_grad_()
    negative_distance(d, d).sum().backward()
    assert torch.isfinite(d.grad).all()


def test_on_unit_norm_both_rank_alike():
    q, d = unit_norm(maps(4)), unit_norm(maps(9, seed=3))
    assert torch.equal(negative_distance(q, d).argsort(1), cosine(q, d).argsort(1))
