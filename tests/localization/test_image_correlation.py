"""Correlation of images: compiled loops beside plain torch, and images at half the resolution."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.localization.alignment import image_correlation
from deepring.localization.alignment.image_correlation import (
    best_fits,
    correlations,
    half_whitened,
    occupied_cells,
    peaks,
    smaller_images,
    turned_images,
)
from deepring.localization.alignment.settings import AlignmentSettings


def some_images(count, cells, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return (torch.rand(count, cells, cells, generator=generator) < 0.1).to(torch.uint8)


def both(monkeypatch, function, *arguments):
    """What the compiled loops give, and what plain torch does."""
    compiled = function(*arguments)
    with monkeypatch.context() as patch:
        patch.setattr(image_correlation, "_compiled", lambda _: False)
        return compiled, function(*arguments)


@pytest.mark.parametrize(("cells", "padded", "reach"), [(24, 36, 10.0), (15, 18, 3.0)])
def test_compiled_loops_and_plain_torch_agree(monkeypatch, cells, padded, reach):
    small = AlignmentSettings(cells, extent=cells / 2, padded=padded, reach=reach, blur=0.5)
    images = some_images(5, cells)
    inside = occupied_cells(images[0], small)
    turns = torch.tensor([[0.0, 1.2, -2.0], [1.2, 0.3, 3.0]])
    for function, arguments in (
        (turned_images, (inside, turns)),
        (smaller_images, (images,)),
        (half_whitened, (images,)),
        (half_whitened, (torch.zeros(1, cells, cells),)),
        (best_fits, (inside, half_whitened(images[1:3], small), turns)),
    ):
        compiled, plain = both(monkeypatch, function, *arguments, small)
        torch.testing.assert_close(compiled, plain, atol=1e-4, rtol=1e-4)


@settings(derandomize=True, max_examples=40, deadline=None)
@given(st.integers(0, 99), st.sampled_from([1.0, 3.0, 7.5, 20.0]))
def test_compiled_and_plain_peaks_agree(seed, reach):
    small = AlignmentSettings(15, extent=7.5, padded=18, reach=reach)
    generator = torch.Generator().manual_seed(seed)
    curves = torch.rand(6, 18, 18, generator=generator)
    with pytest.MonkeyPatch.context() as patch:
        compiled, plain = both(patch, peaks, curves, small)
    for ours, theirs in zip(compiled, plain, strict=True):
        torch.testing.assert_close(ours, theirs)
    # No shift beyond the reach; 18 cells have 8 on either side.
    assert compiled[1].abs().max() <= min(reach, 8) + 1
    assert (compiled[0] <= curves.flatten(1).amax(dim=-1)).all()


@pytest.mark.parametrize("cells", [24, 15, 1])
def test_half_the_resolution_keeps_cells_and_their_middle(cells):
    small = AlignmentSettings(cells, extent=cells / 2, padded=2 * cells)
    coarse = small.coarse
    assert coarse.cell == pytest.approx(2 * small.cell)
    images = some_images(3, cells)
    images[1, cells // 2 :] = 1
    images[2] = 1
    if cells > 1:  # what lies at the border partly falls off, as the corners of a disc do
        images[:, [0, -1]] = images[:, :, [0, -1]] = 0
    smaller = smaller_images(images, small)
    assert smaller.shape == (3, coarse.cells, coarse.cells)

    def moments(image, settings):
        along = (torch.arange(settings.cells) + 0.5) * settings.cell - settings.extent
        return image.float().sum(dim=(1, 2)), (image.float() * along[:, None]).sum(dim=(1, 2))

    for ours, theirs in zip(moments(smaller, coarse), moments(images, small), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-2, rtol=0)


@pytest.mark.parametrize(("cells", "padded"), [(24, 36), (15, 18), (15, 20)])
@pytest.mark.parametrize("compiled", [True, False])
def test_half_a_turn_more_is_the_same_spectrum_seen_from_behind(
    cells, padded, compiled, monkeypatch
):
    monkeypatch.setattr(image_correlation, "_compiled", lambda _: compiled)
    small = AlignmentSettings(cells, extent=cells / 2, padded=padded, reach=5.0, blur=0.5)
    images = some_images(3, cells)
    inside, spectra = occupied_cells(images[0], small), half_whitened(images[1:], small)
    for turn in (0.0, 0.4, -2.5, 3.0):
        turns = torch.tensor([turn, turn + math.pi])
        one, drawn = half_whitened(turned_images(inside, turns, small), small).split(1)
        ours = correlations(spectra, one, torch.tensor([[0, 0, 1], [1, 0, 1]]), small)
        expected = correlations(spectra, drawn, torch.tensor([[0, 0, 0], [1, 0, 0]]), small)
        torch.testing.assert_close(ours, expected, atol=1e-5, rtol=0)
        # The usual misreading: the conjugate alone turns about the first cell, not the middle.
        misread = torch.fft.irfft2(spectra * one, s=(padded, padded), norm="forward")
        assert (misread - expected).abs().max() > 0.1


def test_turns_that_differ_by_rounding_are_turned_once(monkeypatch):
    small = AlignmentSettings(24, extent=12.0, padded=36)
    images, turned = some_images(3, 24), []
    inside, spectra = occupied_cells(images[0], small), half_whitened(images[1:], small)
    turns = torch.tensor([[0.5, 2.0, 0.5 + 1e-7], [2.0 - 2e-7 + math.pi, 0.5 - math.pi, 1.0]])
    expected = best_fits(inside, spectra, turns, small)
    plain = image_correlation.turned_images
    monkeypatch.setattr(
        image_correlation,
        "turned_images",
        lambda cells, turns, settings: turned.append(turns) or plain(cells, turns, settings),
    )
    torch.testing.assert_close(best_fits(inside, spectra, turns, small), expected)
    assert [len(distinct) for distinct in turned] == [3]


def test_parts_of_any_size_give_the_same(monkeypatch):
    small = AlignmentSettings(24, extent=12.0, padded=36)
    images = some_images(7, 24)
    inside, turns = occupied_cells(images[0], small), torch.rand(6, 2, 3)

    def fits():
        return best_fits(inside, half_whitened(images[1:], small), turns, small)

    whole = fits()
    monkeypatch.setattr(image_correlation, "_HELD", 5 * 36**2)
    torch.testing.assert_close(fits(), whole)
    monkeypatch.setattr(image_correlation, "_HELD", 1)
    torch.testing.assert_close(fits(), whole)
