"""The Radon transform against analytic transforms, its symmetries, and its two paths."""

import math

import numpy as np
import pytest
import torch

from deepring.core.equivariance import assert_equivariant, relative_error
from deepring.core.radon import _compiled, _half_turn, radon
from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.rasters.bev import bev_occupancy
from helpers.scenes import scattered


def grid(n, extent=1.0):
    axis = (torch.arange(n) + 0.5) * (2 * extent / n) - extent
    return torch.meshgrid(axis, axis, indexing="ij")


def taus(n, extent=1.0):
    return (torch.arange(n) + 0.5) * (2 * extent / n) - extent


def test_disc_matches_chord_length():
    x, y = grid(240)
    sinogram = radon(((x - 0.2) ** 2 + (y + 0.1) ** 2 <= 0.5**2).float(), angles=120)
    theta = torch.arange(120) * (2 * math.pi / 120)
    shifted = taus(240)[None] - (0.2 * theta.cos() - 0.1 * theta.sin())[:, None]
    chord = 2 * (0.25 - shifted**2).clamp_min(0).sqrt()
    error = relative_error(sinogram, chord)
    print(f"disc: relative error {error:.4f}")
    assert error < 0.02


def test_gaussian_matches_its_analytic_transform():
    x, y = grid(120)
    s, x0, y0 = 0.12, 0.25, -0.15
    image = torch.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * s * s))
    sinogram = radon(image, angles=120)
    theta = torch.arange(120) * (2 * math.pi / 120)
    shifted = taus(120)[None] - (x0 * theta.cos() + y0 * theta.sin())[:, None]
    analytic = s * math.sqrt(2 * math.pi) * torch.exp(-(shifted**2) / (2 * s * s))
    error = relative_error(sinogram, analytic)
    print(f"Gaussian: relative error {error:.4f}")
    assert error < 0.02
    # The usual misreading, the image's first axis taken for y, is far off.
    assert relative_error(radon(image.T, angles=120), analytic) > 0.5


def test_values_are_line_integrals_in_the_unit_of_extent():
    x, y = grid(120, extent=70.0)
    square = ((x.abs() < 35) & (y.abs() < 35)).float()
    sinogram = radon(square, angles=120, extent=70.0)
    assert sinogram[0, 55:65].sub(70.0).abs().max() < 1e-3


def test_mass_is_kept_in_every_row():
    bev = torch.from_numpy(bev_occupancy(scattered(0)))
    rows = radon(bev, angles=120, extent=70.0).sum(-1) * (140 / 120)
    assert torch.allclose(rows, bev.sum() * (140 / 120) ** 2, rtol=1e-5)


def test_half_turn_flips_tau_exactly():
    sinogram = radon(torch.from_numpy(bev_occupancy(scattered(1))), angles=120)
    assert torch.equal(sinogram.roll(60, 0), sinogram.flip(1))


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_quarter_turns_of_the_image_shift_rows_exactly(quarters):
    bev = torch.from_numpy(bev_occupancy(scattered(2))).float()
    # Indexed [x, y], a counter-clockwise quarter turn takes (x, y) to (-y, x).
    error = assert_equivariant(
        lambda image: radon(image, angles=120),
        bev,
        lambda image: torch.rot90(image, quarters, dims=(0, 1)),
        lambda sinogram: sinogram.roll(30 * quarters, dims=0),
        tolerance=1e-5,
    )
    print(f"quarter turns {quarters}: relative error {error:.2g}")
    with pytest.raises(AssertionError):  # the misreading: rows move the other way
        assert_equivariant(
            lambda image: radon(image, angles=120),
            bev,
            lambda image: torch.rot90(image, 1, dims=(0, 1)),
            lambda sinogram: sinogram.roll(-30, dims=0),
        )


@pytest.mark.parametrize("steps", [1, 7, 40])
def test_turning_the_points_shifts_rows_up_to_the_grid(steps):
    points = scattered(3)
    turned = turn_points(points, steps * 2 * math.pi / 120)
    a, b = (
        radon(torch.from_numpy(bev_occupancy(p)), angles=120).roll(k, 0)
        for p, k in ((points, steps), (turned, 0))
    )
    other = radon(torch.from_numpy(bev_occupancy(scattered(4))), angles=120)
    error, unrelated = relative_error(b, a), relative_error(b, other)
    print(f"turn by {steps} steps: error {error:.3f}, unrelated scans {unrelated:.3f}")
    assert error < 0.15 < unrelated


def test_translation_shifts_each_row_by_its_projection():
    points = scattered(5)
    moved = points + np.array([7.0, -4.0, 0.0], dtype=np.float32) * np.float32(140 / 120)
    a, b = (radon(torch.from_numpy(bev_occupancy(p)), angles=120) for p in (points, moved))
    # Rows at 0, 90, 180 and 270 degrees move by whole bins: exact.
    for row, bins in ((0, 7), (30, -4), (60, -7), (90, 4)):
        assert torch.allclose(a[row].roll(bins), b[row], atol=1e-5)
        assert not torch.allclose(a[row].roll(-bins), b[row], atol=1e-5)


def test_without_the_disc_mask_corners_break_equivariance():
    rng = np.random.default_rng(0)
    points = rng.uniform(-70, 70, (800, 3)).astype(np.float32)
    turned = turn_points(points, 15 * 2 * math.pi / 120)

    def error(disc):
        a, b = (
            radon(torch.from_numpy(bev_occupancy(p, disc=disc)), angles=120)
            for p in (points, turned)
        )
        return relative_error(b, a.roll(15, 0))

    masked, unmasked = error(True), error(False)
    print(f"masked {masked:.3f}, unmasked {unmasked:.3f}")
    assert unmasked > masked + 0.05


def test_compiled_and_torch_paths_agree():
    bev = torch.rand(3, 30, 30, generator=torch.Generator().manual_seed(0)) > 0.7
    for bins in (30, 17, 64):
        images = bev.float()
        compiled, plain = _compiled(images, 20, 20, bins, 1.0), _half_turn(images, 20, bins)
        assert torch.allclose(compiled, plain, atol=1e-4, rtol=1e-5)


def test_brute_force_reference():
    image = torch.zeros(6, 6)
    image[1, 4], image[3, 2] = 2.0, 1.0
    expected = np.zeros((8, 6))
    for k in range(8):
        theta = 2 * math.pi * k / 8
        for (i, j), value in {(1, 4): 2.0, (3, 2): 1.0}.items():
            t = (i - 2.5) * math.cos(theta) + (j - 2.5) * math.sin(theta) + 2.5
            for m in range(6):
                expected[k, m] += value * max(0.0, 1 - abs(t - m)) * (2 / 6)
    assert np.allclose(radon(image, angles=8), expected, atol=1e-6)


def test_gradient_flows_through_the_torch_path():
    image = torch.rand(8, 8, dtype=torch.float32).requires_grad_()
    radon(image, angles=8).square().sum().backward()
    assert image.grad is not None
    assert torch.isfinite(image.grad).all()
    assert image.grad.abs().sum() > 0


@pytest.mark.parametrize(("shape", "angles"), [((4, 5), 8), ((4, 4), 7), ((4,), 8)])
def test_bad_arguments_are_named(shape, angles):
    with pytest.raises(DeepringError, match="radon"):
        radon(torch.zeros(shape), angles=angles)


def test_half_a_turn_is_the_first_half_of_a_full_one():
    image = torch.rand(3, 20, 20)
    full, half = radon(image, 24, 18), radon(image, 12, 18, theta_range="half")
    assert torch.equal(half, full[:, :12])
    assert radon(image, 11, 18, theta_range="half").shape == (3, 11, 18)  # odd is no trouble here
    gradient = image.clone().requires_grad_()
    assert torch.allclose(radon(gradient, 12, 18, theta_range="half"), half, atol=1e-5)
