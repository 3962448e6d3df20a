"""Aggregation over τ: shapes, invariances, and what each does not undo."""

import math

import pytest
import torch

from deepring.core.equivariance import (
    EquivarianceError,
    assert_equivariant,
    assert_invariant,
    assert_tau_invariant,
)
from deepring.core.spectrum import column_dft_magnitude, cross_spectrum, row_dft
from deepring.errors import ConfigError
from deepring.nn.aggregation import PAPER, cross_spectra, dft, gap, gmp, make_aggregation

ROWS, BINS = 12, 16


def feature(channels=1, batch=2, bins=BINS):
    return torch.randn(batch, channels, ROWS, bins, generator=torch.Generator().manual_seed(0))


PAIRS = {"gaps": [30, 90], "frequencies": 5}  # one row and three rows apart


def of_pairs(x):
    return make_aggregation("cross_spectra", ROWS, BINS, **PAIRS).function(x)


@pytest.mark.parametrize(
    ("kind", "values"),
    [("dft", 9), ("dft2", 9), ("gap", 1), ("gmp", 1), ("multi_gap", 9), ("cross_spectra", 26)],
)
def test_shapes_of_what_the_network_gives(kind, values):
    made = make_aggregation(kind, ROWS, BINS, **(PAIRS if kind == "cross_spectra" else {}))
    assert made.values == values
    assert made.function(feature(made.channels)).shape == (2, ROWS, values)


@pytest.mark.parametrize("bins", [15, 16, 60, 120])
def test_multi_gap_keeps_the_size_of_the_descriptor(bins):
    by_dft, by_gap = (make_aggregation(kind, ROWS, bins) for kind in ("dft", "multi_gap"))
    assert by_gap.values == by_dft.values


@pytest.mark.parametrize("function", [*PAPER.values(), of_pairs])
@pytest.mark.parametrize("channels", [1, 3])
def test_shifts_of_tau_leave_no_trace(function, channels):
    assert_tau_invariant(function, feature(channels), 5)


@pytest.mark.parametrize("kind", PAPER)
def test_shifts_that_differ_from_row_to_row_leave_no_trace(kind):
    shifts = torch.arange(ROWS) * 5 % 7

    def translate(x):
        rows = [x[..., k, :].roll(int(s), -1) for k, s in enumerate(shifts)]
        return torch.stack(rows, dim=-2)

    assert_invariant(PAPER[kind], feature(), translate)
    with pytest.raises(EquivarianceError):
        assert_invariant(of_pairs, feature(), translate, 0.1)


@pytest.mark.parametrize("function", [dft, gap, gmp, of_pairs])
def test_shifts_of_theta_roll_the_rows(function):
    # The descriptor is (b, θ, m): rows lie on its second axis, not on its last but one channel.
    assert_equivariant(
        function, feature(3), lambda x: x.roll(5, dims=2), lambda d: d.roll(5, dims=1)
    )
    with pytest.raises(EquivarianceError):
        assert_invariant(function, feature(3), lambda x: x.roll(5, dims=2), 0.1)


def test_a_second_dft_undoes_the_rotation_too():
    assert_invariant(
        lambda x: column_dft_magnitude(dft(x)), feature(3), lambda x: x.roll(5, dims=2)
    )


def test_dft_keeps_apart_what_the_means_confuse():
    one, other = feature(), feature().flip(-1) * torch.tensor([1.0])
    other[..., 0], other[..., 5] = other[..., 5].clone(), other[..., 0].clone()
    assert torch.allclose(gap(one), gap(other), atol=1e-6)
    assert torch.allclose(gmp(one), gmp(other))
    assert not torch.allclose(dft(one), dft(other), atol=1e-2)


def test_values_by_hand():
    x = torch.tensor([[[[1.0, 2.0, 6.0], [0.0, -3.0, 3.0]], [[1.0, 1.0, 1.0], [2.0, 0.0, 1.0]]]])
    assert torch.allclose(gap(x), torch.tensor([[[3.0, 1.0], [0.0, 1.0]]]))
    assert torch.allclose(gmp(x), torch.tensor([[[6.0, 1.0], [3.0, 2.0]]]))
    # The zero frequency of the orthonormal DFT is the sum over the root of the length.
    assert torch.allclose(dft(x)[0, :, 0], torch.tensor([9.0, 0.0]) / 3**0.5)
    assert torch.allclose(dft(x)[0, :, 2], torch.tensor([3.0, 3.0]) / 3**0.5)


def test_pairs_by_the_definition():
    x = feature(2)
    full = torch.fft.fft(x.double(), dim=-1, norm="ortho")
    pair = full * full.roll(-1, dims=2).conj()
    pair = pair / pair.abs().sqrt()
    # Over the whole spectrum, of which the descriptor keeps half.
    inner = (pair[0].conj() * pair[1])[..., 1:].real.sum()
    one, other = cross_spectrum(row_dft(x), 1)[..., 1:]
    assert torch.allclose((one.conj() * other).real.sum().double(), inner, atol=1e-4)


def test_magnitudes_and_the_pairs_of_each_gap_have_the_same_norm():
    parts = of_pairs(feature()).split([6, 10, 10], dim=-1)
    for part in parts:
        assert torch.allclose(part.square().sum((1, 2)), torch.ones(2), atol=1e-5)


def test_a_translation_turns_the_phases_by_its_difference_between_the_directions():
    angle = 2 * math.pi * torch.arange(ROWS) / ROWS
    shift = 1.3 * torch.cos(angle) + 0.4 * torch.sin(angle)  # bins, of each row (Eq. 3)
    omega = 2 * math.pi * torch.arange(BINS // 2 + 1) / BINS
    spectrum = row_dft(feature())
    moved = spectrum * torch.exp(-1j * omega * shift[:, None])
    for between in (1, 3):
        turned = torch.exp(-1j * omega * (shift - shift.roll(-between))[:, None])
        expected = cross_spectrum(spectrum, between) * turned
        assert torch.allclose(cross_spectrum(moved, between), expected, atol=1e-5)
        # The usual misreading: a magnitude of pairs would forget the translation altogether.
        assert torch.allclose(expected.abs(), cross_spectrum(spectrum, between).abs(), atol=1e-5)


def test_the_nearer_two_directions_the_less_a_translation_changes():
    x = feature()
    shifts = (2 * torch.cos(2 * math.pi * torch.arange(ROWS) / ROWS)).round().int().tolist()
    moved = torch.stack([x[..., k, :].roll(s, -1) for k, s in enumerate(shifts)], dim=-2)

    def change(gaps, frequencies):
        before, after = (cross_spectra(y, gaps, frequencies).flatten(1) for y in (x, moved))
        return float((before - after).norm() / before.norm())

    assert change([1], 2) < change([3], 2) < change([3], 8)


def test_silent_directions_have_no_phase_and_a_finite_gradient():
    x = feature()
    x[:, :, 4] = 0
    x.requires_grad_()
    d = of_pairs(x)
    d.square().sum().backward()
    assert not d[:, 4].any()
    assert torch.isfinite(x.grad).all()


def test_a_feature_without_any_phase_has_a_finite_gradient():
    # An image whose every cell was lost: the feature is constant.
    x = torch.full((1, 1, ROWS, BINS), 0.3, requires_grad=True)
    d = of_pairs(x)
    (d * torch.randn(d.shape)).sum().backward()
    assert d[..., :6].any()
    assert not d[..., 6:].abs().gt(1e-2).any()
    assert torch.isfinite(x.grad).all()


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        ("mean", {}, "aggregation.kind: 'mean'"),
        ("dft", {"gaps": [30]}, r"aggregation.gaps: \[30\], expected null"),
        ("gap", {"frequencies": 3}, "aggregation.frequencies: 3, expected null"),
        ("cross_spectra", {"frequencies": 3}, "aggregation.gaps: None, expected degrees"),
        ("cross_spectra", {"gaps": [], "frequencies": 3}, "aggregation.gaps"),
        ("cross_spectra", {"gaps": [45], "frequencies": 3}, "multiples of 30"),
        ("cross_spectra", {"gaps": [0], "frequencies": 3}, "aggregation.gaps"),
        ("cross_spectra", {"gaps": [210], "frequencies": 3}, "up to 180"),
        ("cross_spectra", {"gaps": [30]}, "aggregation.frequencies: null"),
        ("cross_spectra", {"gaps": [30], "frequencies": 9}, "aggregation.frequencies: 9"),
    ],
)
def test_other_values_are_refused(kind, values, message):
    with pytest.raises(ConfigError, match=message):
        make_aggregation(kind, ROWS, BINS, **values)
