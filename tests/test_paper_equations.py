"""The equations of the paper, a test each, beside their usual misreadings.

The paper numbers nine equations; its loss follows the ninth in words. What holds exactly is tested
exactly; what the grid spoils is measured, and bounded from both sides.
"""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.correlation import circular_cross_correlation, correlation_curves, unit_norm
from deepring.core.equivariance import assert_equivariant, assert_invariant, relative_error
from deepring.core.radon import radon
from deepring.core.rigid import turn_points
from deepring.core.spectrum import row_dft_magnitude
from deepring.nn.circular import CircularConv2d
from deepring.nn.unet import CircularUNet
from deepring.rasters.bev import bev_occupancy
from deepring.rasters.polar import polar_gram
from deepring.training.episodes import OneShotCrossEntropy
from helpers.scenes import scattered

ANGLES, CELLS = 120, 120


def theta():
    return torch.arange(ANGLES) * (2 * math.pi / ANGLES)


def blobs(seed, moved=(0.0, 0.0), turn=0.0):
    """A smooth image of Gaussians (n, n), turned by ``turn`` and then moved, half a side = 1."""
    rng = np.random.default_rng(seed)
    centres = turn_points(np.column_stack([rng.uniform(-0.35, 0.35, (5, 2)), np.zeros(5)]), turn)
    axis = (np.arange(CELLS) + 0.5) * (2 / CELLS) - 1
    x, y = np.meshgrid(axis, axis, indexing="ij")
    image = sum(
        weight * np.exp(-((x - a - moved[0]) ** 2 + (y - b - moved[1]) ** 2) / (2 * 0.07**2))
        for weight, (a, b, _) in zip(rng.uniform(0.5, 1, 5), centres, strict=True)
    )
    return torch.from_numpy(image).float()


def shift_tau(sinogram, bins):
    """Each row moved along τ by its own number of bins (θ,), fractions too: a phase ramp."""
    frequency = torch.fft.rfftfreq(sinogram.shape[-1])
    ramp = torch.exp(-2j * math.pi * frequency * bins[:, None])
    return torch.fft.irfft(torch.fft.rfft(sinogram) * ramp, n=sinogram.shape[-1])


def projected(moved, sign=1):
    """Δτ = Δx cos θ + Δy sin θ in bins."""
    return (moved[0] * theta().cos() + sign * moved[1] * theta().sin()) * (CELLS / 2)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(0.06, 0.12))
def test_equation_1_the_sinogram_holds_integrals_over_lines(x0, y0, s):
    axis = (torch.arange(CELLS) + 0.5) * (2 / CELLS) - 1
    x, y = torch.meshgrid(axis, axis, indexing="ij")
    image = torch.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * s * s))

    def analytic(towards):
        offset = axis[None] - towards[:, None]
        return s * math.sqrt(2 * math.pi) * torch.exp(-(offset**2) / (2 * s * s))

    cosine, sine = theta().cos(), theta().sin()
    assert relative_error(radon(image, ANGLES), analytic(x0 * cosine + y0 * sine)) < 0.02
    if abs(y0) > 0.1:  # the line is x cos θ + y sin θ = τ, and y grows to the left
        assert relative_error(radon(image, ANGLES), analytic(x0 * cosine - y0 * sine)) > 0.3
    if abs(x0 - y0) > 0.1:  # the image's first axis is x
        assert relative_error(radon(image, ANGLES), analytic(y0 * cosine + x0 * sine)) > 0.2


@settings(max_examples=12, deadline=None)
@given(st.integers(1, ANGLES - 1), st.integers(0, 99))
def test_equation_2_a_rotation_shifts_theta(steps, seed):
    """Exact for quarters of a turn, which the grid takes to itself; else up to the grid.

    R(θ + α, τ) is what a turn of the points by -α gives; by +α, rows are rolled by +α.
    """
    alpha = steps * 2 * math.pi / ANGLES
    before, after = radon(blobs(seed), ANGLES), radon(blobs(seed, turn=alpha), ANGLES)
    assert relative_error(after, before.roll(steps, 0)) < 0.04
    if 5 < steps < ANGLES - 5 and abs(steps - ANGLES // 2) > 5:
        assert relative_error(after, before.roll(-steps, 0)) > 0.2  # the other way round
    for quarters in (1, 2, 3):
        assert_equivariant(
            lambda image: radon(image, ANGLES),
            blobs(seed),
            lambda image, k=quarters: torch.rot90(image, k, dims=(0, 1)),
            lambda rows, k=quarters: rows.roll(k * ANGLES // 4, 0),
            tolerance=1e-5,
        )


@settings(max_examples=15, deadline=None)
@given(st.integers(-18, 18), st.integers(-18, 18), st.integers(0, 99))
def test_equation_3_a_translation_shifts_each_row_by_its_projection(right, up, seed):
    """Exact in the rows along the axes, for whole cells; elsewhere up to the grid."""
    dx, dy = right * 2 / CELLS, up * 2 / CELLS
    before, after = radon(blobs(seed), ANGLES), radon(blobs(seed, (dx, dy)), ANGLES)
    assert relative_error(after, shift_tau(before, projected((dx, dy)))) < 0.05
    for row, bins in ((0, right), (30, up), (60, -right), (90, -up)):
        assert torch.allclose(after[row], before[row].roll(bins), atol=1e-5)
    if math.hypot(dx, dy) > 0.1:
        assert relative_error(after, shift_tau(before, -projected((dx, dy)))) > 0.3
        # No shift that all rows share does it.
        rolls = [relative_error(after, before.roll(k, 1)) for k in range(CELLS)]
        assert min(rolls) > 0.3
    if abs(dy) > 0.05:
        assert relative_error(after, shift_tau(before, projected((dx, dy), sign=-1))) > 0.2


@settings(max_examples=30, deadline=None)
@given(st.floats(5, 45), st.floats(-math.pi, math.pi), st.floats(-20, 20), st.floats(-20, 20))
def test_equation_4_a_translation_moves_polar_cells_nonlinearly(r, angle, dx, dy):
    """r' and θ' of the paper lead from a cell of the moved gram back to where it was."""
    sectors, rings, radius = 360, 140, 70.0
    point = np.array([[r * math.cos(angle), r * math.sin(angle), 1.0]], dtype=np.float32)
    ((sector, ring),) = np.argwhere(
        polar_gram(point + np.float32([dx, dy, 0]), radius, sectors, rings)
    )
    a, q = (sector + 0.5) * 2 * math.pi / sectors, (ring + 0.5) * radius / rings
    x, y = q * math.cos(a) - dx, q * math.sin(a) - dy
    # Off by no more than half a cell in either direction, as wide as it is at its outer border.
    outer = q + radius / rings / 2
    slack = math.hypot(radius / rings, outer * 2 * math.pi / sectors) / 2 + 1e-4
    assert math.dist((x, y), point[0, :2]) < slack
    r_back, theta_back = math.hypot(x, y), math.atan2(y, x)
    assert abs(r_back - r) < slack
    assert abs((theta_back - angle + math.pi) % (2 * math.pi) - math.pi) < 2 * slack / r
    # The paper's arctan needs the quadrant: without it, half of all points come out behind.
    if point[0, 0] < -3 * slack:
        assert abs(math.atan(y / x) - theta_back) == pytest.approx(math.pi)


def test_equation_4_no_shift_of_the_polar_gram_undoes_a_translation():
    points = scattered(0, radius=40.0)
    moved = points + np.float32([5, -3, 0])
    before, after = (
        torch.from_numpy(polar_gram(p)).float() - polar_gram(p).mean() for p in (points, moved)
    )
    spectrum = torch.fft.rfft2(after) * torch.fft.rfft2(before).conj()
    best = torch.fft.irfft2(spectrum, s=before.shape).max() / (before.norm() * after.norm())
    print(f"correlation of polar grams 6 m apart at their best shift: {best:.3f}")
    assert best < 0.5
    rows = [radon(torch.from_numpy(bev_occupancy(p)), ANGLES, extent=70) for p in (points, moved)]
    undone = shift_tau(rows[0], projected((5 / 70, -3 / 70)))
    assert relative_error(rows[1], undone) < 0.2  # Eq. 3 undoes it for the sinogram


@pytest.mark.parametrize("size", [1, 3, 5])
def test_equation_5_the_convolution_wraps_around_both_axes(size):
    torch.manual_seed(0)
    layer = CircularConv2d(1, 1, size, bias=False).double()
    image = torch.randn(1, 1, 9, 8, dtype=torch.float64)
    # torch slides a kernel without turning it: the paper's K is its kernel turned by half a turn.
    kernel = layer.conv.weight[0, 0].detach().flip(0, 1)

    def convolution(k):
        """Σ_mn R[(i - m) % M, (j - n) % N] K[m, n], m and n counted from the kernel's centre."""
        terms = [
            k[m, n] * image.roll((m - size // 2, n - size // 2), dims=(-2, -1))
            for m in range(size)
            for n in range(size)
        ]
        return torch.stack(terms).sum(0)

    with torch.no_grad():
        assert relative_error(layer(image), convolution(kernel)) < 1e-14
        if size > 1:
            assert relative_error(layer(image), convolution(kernel.flip(0, 1))) > 0.1
            zeros = torch.nn.functional.conv2d(image, layer.conv.weight, padding=size // 2)
            assert relative_error(layer(image), zeros) > 0.1  # padded by zeros, not wrapped


def test_equation_6_features_shift_with_tau():
    """Exact where all rows shift alike, and for any shifts where a kernel sees one row alone.

    A translation shifts neighbouring rows by different amounts, so that the paper's Eq. 6 holds
    up to what a kernel of several rows mixes: measured here, small since Δτ varies slowly.
    """
    torch.manual_seed(0)
    unet = CircularUNet((4, 6), norm="group").double().eval()
    sinogram = radon(blobs(1), ANGLES)[None, None].double()
    for shift in (2, -8, 60):  # multiples of the stride
        assert_equivariant(
            unet,
            sinogram,
            lambda x, k=shift: x.roll(k, -1),
            lambda x, k=shift: x.roll(k, -1),
            tolerance=1e-12,
        )
    moved = (0.15, -0.1)
    bins = projected(moved).double()
    one_row, three_rows = (CircularConv2d(1, 2, size, bias=False).double() for size in (1, 3))

    def error(layer, shifts):
        def translate(x):
            return shift_tau(x, shifts)

        with torch.no_grad():
            return relative_error(layer(translate(sinogram)), translate(layer(sinogram)))

    assert error(one_row, bins) < 1e-12
    slow, fast = error(three_rows, bins), error(three_rows, bins[torch.randperm(ANGLES)])
    print(f"Eq. 6 under a translation: off by {slow:.4f}; rows shifted at random: {fast:.2f}")
    assert 1e-5 < slow < 0.05
    assert fast > 5 * slow


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(-30, 30), min_size=12, max_size=12), st.integers(0, 99))
def test_equation_7_the_magnitude_of_a_row_forgets_its_shift(shifts, seed):
    feature = torch.randn(2, 1, 12, 16, generator=torch.Generator().manual_seed(seed))

    def translate(x):  # each row by its own shift, as a translation does
        return torch.stack([x[..., k, :].roll(s, -1) for k, s in enumerate(shifts)], -2)

    assert_invariant(row_dft_magnitude, feature, translate)
    full = torch.fft.fft(feature, dim=-1, norm="ortho").abs()
    assert torch.allclose(row_dft_magnitude(feature).norm(), full.norm(), rtol=1e-5)
    if len({s % 16 for s in shifts}) > 3:
        with pytest.raises(AssertionError):  # the 2-D spectrum wants all rows shifted alike
            assert_invariant(lambda x: torch.fft.rfft2(x).abs(), translate(feature), translate)
    if any(s % 16 for s in shifts):
        with pytest.raises(AssertionError):  # with its phase, the spectrum remembers
            assert_invariant(torch.fft.rfft, feature, translate)


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 9), st.integers(1, 5), st.integers(0, 8), st.integers(0, 99))
def test_equation_8_the_correlation_is_the_largest_over_circular_shifts(rows, width, turn, seed):
    generator = torch.Generator().manual_seed(seed)
    first = torch.randn(2, rows, width, generator=generator)
    second = torch.randn(3, rows, width, generator=generator)
    curves = torch.stack(  # Σ_θω M1(θ + α, ω) M2(θ, ω), θ + α wrapping
        [torch.einsum("qtw,dtw->qd", first.roll(-alpha, 1), second) for alpha in range(rows)], -1
    )
    assert torch.allclose(correlation_curves(first, second), curves, atol=1e-4)
    match = circular_cross_correlation(first, second)
    assert torch.allclose(match.score, curves.amax(-1), atol=1e-4)
    # A place seen at another heading is the same place, and α tells the heading.
    again = circular_cross_correlation(first.roll(turn, 1), first)
    assert torch.equal(again.shift.diagonal(), torch.full((2,), turn % rows))
    assert torch.allclose(again.score.diagonal(), first.square().sum((1, 2)), rtol=1e-4)
    if turn % rows > 0 and rows > 2 and 2 * turn % rows:
        assert (again.shift.diagonal() != -turn % rows).all()  # not its mirror
        # Without wrapping, what is turned past the end is lost.
        lost = max(
            (first[0, alpha:] * first[0].roll(turn, 0)[: rows - alpha]).sum()
            for alpha in range(rows)
        )
        assert lost < again.score[0, 0]


def correlation(queries, database):
    return circular_cross_correlation(queries, database).score


def episode(ways=6, seed=0):
    """Descriptors (ways, θ, ω) of places, and queries of the same places, turned and noisy."""
    generator = torch.Generator().manual_seed(seed)
    places = torch.rand(ways, 12, 5, generator=generator)
    noise = 0.3 * torch.rand(ways, 12, 5, generator=generator)
    return unit_norm((places + noise).roll(4, 1)), unit_norm(places)[:, None]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 99), st.floats(1, 200), st.floats(-5, 5))
def test_equation_9_two_numbers_and_a_softmax_make_probabilities(seed, weight, bias):
    queries, support = episode(seed=seed)
    classifier = OneShotCrossEntropy(weight).classifier
    assert [p.numel() for p in classifier.parameters()] == [1, 1]  # W and b in ℝ
    with torch.no_grad():
        classifier.bias.fill_(bias)
        probability = classifier(queries, support, correlation).softmax(dim=1)
        expected = (weight * correlation(queries, support[:, 0]) + bias).softmax(dim=1)
        assert torch.allclose(probability, expected, atol=1e-5)
        assert torch.allclose(probability.sum(1), torch.ones(6))
        assert torch.equal(probability.argmax(1), torch.arange(6))
        # The ways of an episode have no order: a matrix W would learn one.
        order = torch.randperm(6, generator=torch.Generator().manual_seed(seed))
        permuted = classifier(queries, support[order], correlation).softmax(dim=1)
        assert torch.allclose(permuted, probability[:, order], atol=1e-5)
        matrix = torch.nn.Linear(6, 6)
        scores = correlation(queries, support[:, 0])
        if not torch.equal(order, torch.arange(6)):
            assert not torch.allclose(matrix(scores[:, order]), matrix(scores)[:, order], atol=1e-4)
        # b, the same for all ways, cancels.
        classifier.bias.zero_()
        unbiased = classifier(queries, support, correlation).softmax(dim=1)
        assert torch.allclose(probability, unbiased, atol=1e-5)


def test_the_loss_after_equation_9_is_cross_entropy_over_the_ways():
    queries, support = episode()
    targets = torch.tensor([0, 1, 2, 3, 4, 0])
    loss = OneShotCrossEntropy(20.0)
    value = loss(queries, support, targets, correlation)[0]
    probability = loss.classifier(queries, support, correlation).softmax(dim=1)
    own = probability[torch.arange(6), targets]
    assert torch.allclose(value, -own.log().mean(), atol=1e-6)
    # Not the binary cross-entropy of each pair, which the paper turns down.
    binary = torch.nn.functional.binary_cross_entropy(
        probability, torch.nn.functional.one_hot(targets, 6).float()
    )
    assert (value - binary).abs() > 0.05
    value.backward()
    assert loss.classifier.weight.grad.abs() > 1e-6
    assert loss.classifier.bias.grad.abs() < 1e-6
