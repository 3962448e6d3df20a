"""The best fit of a scan with one place elsewhere, by brute force and where the answer is known."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.localization.alignment import align
from deepring.localization.alignment.image_correlation import half_whitened, occupied_cells
from deepring.localization.candidates import RerankSettings
from deepring.localization.rivals import fit_elsewhere
from deepring.rasters.bev import bev_occupancy
from helpers.scenes import scattered

SETTINGS = RerankSettings()


def image_of(points):
    return torch.from_numpy(bev_occupancy(points.astype(np.float32)))


def aligned(image, place, turn):
    settings = SETTINGS.alignment
    cells, spectra = occupied_cells(image, settings), half_whitened(place[None], settings)
    found = align(cells, spectra, torch.tensor([[turn]]), settings)
    return float(found.score), float(found.turn), found.position[0]


def fits(image, place):
    """Correlation of two upright images by its definition: {shift in cells: fit}."""

    def whitened(values):
        settings = SETTINGS.alignment
        side = settings.padded
        spectrum = np.fft.fft2(values.numpy().astype(float), (side, side))
        kx, ky = np.meshgrid(*[np.fft.fftfreq(side)] * 2, indexing="ij")
        blur = np.exp(-2 * (np.pi * settings.blur / settings.cell) ** 2 * (kx**2 + ky**2))
        blur[0, 0] = 0
        spectrum = spectrum * blur
        spectrum /= np.sqrt(np.maximum(np.abs(spectrum), 1e-12))
        return spectrum / np.linalg.norm(spectrum)

    side = SETTINGS.alignment.padded
    curve = np.fft.ifft2(whitened(place) * whitened(image).conj()).real * side**2
    reach = range(-SETTINGS.alignment.shifts, SETTINGS.alignment.shifts + 1)
    return {(i, j): curve[i, j] for i in reach for j in reach}


@pytest.mark.parametrize("shift", [(0.0, 0.0), (10.5, -7.0)])
def test_it_is_the_largest_fit_that_contradicts(shift):
    points = scattered(3)
    place, image = image_of(points), image_of(points - np.float32([*shift, 0]))
    cell = SETTINGS.alignment.cell
    position = torch.tensor(shift)
    same = [
        fit
        for (i, j), fit in fits(image, place).items()
        if math.hypot(i * cell - shift[0], j * cell - shift[1]) > SETTINGS.apart
    ]
    opposite = fits(image.flip(0, 1), place).values()
    found = fit_elsewhere(image, place, 0.0, position, SETTINGS)
    assert found == pytest.approx(max(*same, *opposite), rel=1e-3)


def test_a_scene_that_looks_the_same_from_behind_is_its_own_rival():
    points = scattered(1)
    both = np.concatenate([points, turn_points(points, math.pi)])
    for scene, low, high in ((both, 0.95, 1.05), (points, 0.0, 0.7)):
        fit, turn, position = aligned(image_of(scene), image_of(scene), 0.0)
        rival = fit_elsewhere(image_of(scene), image_of(scene), turn, position, SETTINGS)
        assert low < rival / fit < high


def test_a_scene_that_repeats_is_its_own_rival_where_the_copies_lie_apart():
    points = scattered(2, radius=30)
    for step, low, high in ((20.0, 0.7, 1.0), (8.0, 0.0, 0.6)):
        scene = np.concatenate([points, points + np.float32([step, 0, 0])])
        fit, turn, position = aligned(image_of(points), image_of(scene), 0.0)
        rival = fit_elsewhere(image_of(points), image_of(scene), turn, position, SETTINGS)
        assert low < rival / fit <= high
