"""Weighted Kabsch: known transforms, the closed form of SciPy, gradients where torch's fail."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from deepring.nn.rigid_fit import rigid_fit


def cloud(seed=0, batch=2, n=12):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(batch, n, 3, generator=generator, dtype=torch.float64) * 10


def transform(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    shift = np.random.default_rng(seed).normal(0, 20, 3)
    return torch.from_numpy(np.vstack([np.column_stack([rotation, shift]), [0, 0, 0, 1]]))


def moved(points, by):
    return points @ by[..., :3, :3].transpose(-1, -2) + by[..., None, :3, 3]


def test_it_is_the_transform_that_moved_the_points_not_its_inverse():
    points, by = cloud(), torch.stack([transform(0), transform(1)])
    weights = torch.rand(2, 12)
    found, told = rigid_fit(points, moved(points, by), weights)
    assert told.all()
    assert torch.allclose(found, by, atol=1e-9)
    assert not torch.allclose(found, torch.linalg.inv(by), atol=0.1)


def test_points_without_weight_do_not_count():
    points, by = cloud(), torch.stack([transform(2), transform(3)])
    targets, weights = moved(points, by), torch.ones(2, 12)
    targets[:, :4] += 100
    weights[:, :4] = 0
    assert torch.allclose(rigid_fit(points, targets, weights)[0], by, atol=1e-9)


def test_of_noisy_points_it_is_the_best_as_scipy_has_it():
    points, targets = cloud(1, 1), cloud(2, 1)
    weights = torch.rand(1, 12, dtype=torch.float64)
    found = rigid_fit(points, targets, weights)[0][0]
    share = weights / weights.sum()
    p, q = ((x - (share[..., None] * x).sum(dim=1, keepdim=True))[0] for x in (points, targets))
    best, _ = Rotation.align_vectors(q.numpy(), p.numpy(), weights=weights[0].numpy())
    assert np.allclose(found[:3, :3].numpy(), best.as_matrix(), atol=1e-9)


def test_mirrored_clouds_still_give_a_rotation():
    points = cloud(3)
    found, told = rigid_fit(points, points * torch.tensor([1.0, 1.0, -1.0]), torch.ones(2, 12))
    assert torch.allclose(torch.linalg.det(found[:, :3, :3]), torch.ones(2, dtype=torch.float64))
    assert told.all()


@pytest.mark.parametrize("kind", ["one place", "a line"])
def test_points_on_a_line_or_at_one_place_tell_no_turn(kind):
    line = torch.arange(12.0)[None, :, None] * torch.tensor([1.0, 2.0, 0.0])
    points = line if kind == "a line" else line * 0
    found, told = rigid_fit(points, points + 3.0, torch.ones(1, 12))
    assert not told.any()
    assert torch.isfinite(found).all()
    assert torch.allclose(moved(points.double(), found), points.double() + 3.0, atol=1e-6)


def test_all_weights_zero_count_as_equal():
    points, by = cloud(), torch.stack([transform(4), transform(5)])
    assert torch.allclose(rigid_fit(points, moved(points, by), torch.zeros(2, 12))[0], by)


def test_the_gradients_pass_the_numerical_check():
    inputs = [cloud(6, 1, 6), cloud(7, 1, 6), torch.rand(1, 6, dtype=torch.float64)]
    for x in inputs:
        x.requires_grad_()
    assert torch.autograd.gradcheck(lambda *x: rigid_fit(*x)[0], inputs)


def test_equal_singular_values_have_the_numerical_gradient_where_torch_divides_by_zero():
    axes = torch.cat([torch.eye(3), -torch.eye(3)])[None].double()
    turn = torch.from_numpy(Rotation.from_euler("z", 90, degrees=True).as_matrix())
    targets = (axes @ turn.T).requires_grad_()
    weights = torch.ones(1, 6, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda q: rigid_fit(axes, q, weights)[0], [targets])
    matrix = torch.eye(3, dtype=torch.float64, requires_grad=True)
    left, _, right = torch.linalg.svd(matrix)
    (theirs,) = torch.autograd.grad((left @ right)[0, 1], matrix)
    assert not torch.isfinite(theirs).all()


def test_gradients_stay_finite_where_no_turn_is_told():
    line = (torch.arange(6.0)[None, :, None] * torch.tensor([1.0, 0, 0])).requires_grad_()
    found, _ = rigid_fit(line, line.detach() + 1, torch.ones(1, 6))
    (grad,) = torch.autograd.grad(found[:, :3].square().sum() * math.pi, line)
    assert torch.isfinite(grad).all()
