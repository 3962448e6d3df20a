"""The polar image of a BEV: an analytic and a brute-force reference, and the sense of its rows."""

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import map_coordinates

from deepring.core.correlation import correlation_curves
from deepring.core.equivariance import EquivarianceError, assert_equivariant
from deepring.nn.polar_bev import PolarBev
from deepring.nn.representation import Sinogram
from deepring.rasters.bev import bev_occupancy, disc_mask
from deepring.rasters.polar import polar_gram


def bev(cells=40, batch=2):
    occupied = torch.rand(batch, cells, cells, generator=torch.Generator().manual_seed(0)) > 0.9
    return (occupied & torch.from_numpy(disc_mask(cells).copy())).to(torch.uint8)


def points(n=900, seed=0):
    """Walls and posts at heights above the ground, within 65 m."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-45, 45, (12, 2, 2))
    along = rng.random((12, n // 12, 1))
    walls = (ends[:, :1] * along + ends[:, 1:] * (1 - along)).reshape(-1, 2)
    return np.column_stack([walls, rng.uniform(1, 5, len(walls))]).astype(np.float32)


def turned(scan, angle):
    c, s = math.cos(angle), math.sin(angle)
    return (scan @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])).astype(np.float32)


def best_shift(one, other):
    curve = correlation_curves(one.flatten(2)[:, 0].reshape(1, *one.shape[-2:]), other[0])
    shift = int(curve.argmax())
    return shift - curve.shape[-1] if shift > curve.shape[-1] // 2 else shift


def test_shapes_and_types():
    image = PolarBev(sectors=12, rings=10, samples=3)
    for given in (bev(), bev().bool(), bev().float()):
        out = image(given)
        assert out.shape == (2, 1, 12, 10)
        assert out.dtype == torch.float32
        assert out.equal(image(bev()))
    assert not list(image.parameters())
    assert not image.state_dict()  # nothing that weights would have to carry


@pytest.mark.parametrize("quarters", [1, 2, 3])
@pytest.mark.parametrize(("cells", "samples"), [(40, 2), (41, 1)])
def test_a_quarter_turn_rolls_a_quarter_of_the_rows(quarters, cells, samples):
    image = PolarBev(48, 20, samples=samples)

    def rot(x):
        return torch.rot90(x, quarters, dims=(1, 2))

    assert_equivariant(image, bev(cells), rot, lambda p: p.roll(quarters * 12, 2), 1e-5)
    if quarters != 2:
        with pytest.raises(EquivarianceError):
            assert_equivariant(image, bev(cells), rot, lambda p: p.roll(-quarters * 12, 2), 1e-5)


def test_it_reproduces_what_is_linear_between_the_centres_of_cells():
    cells, sectors, rings, samples = 40, 16, 10, 2
    centre = (torch.arange(cells).double() + 0.5) / cells * 2 - 1  # not linspace(-1, 1, cells)
    plane = (0.3 * centre[:, None] - 0.8 * centre[None, :] + 0.1).float()[None]
    found = PolarBev(sectors, rings, reach=0.9, samples=samples)(plane)[0, 0]

    theta = (np.arange(sectors * samples) + 0.5) * 2 * np.pi / (sectors * samples)
    r = (np.arange(rings * samples) + 0.5) * 0.9 / (rings * samples)
    value = 0.3 * np.outer(np.cos(theta), r) - 0.8 * np.outer(np.sin(theta), r) + 0.1
    expected = value.reshape(sectors, samples, rings, samples).mean((1, 3))
    assert np.abs(found.numpy() - expected).max() < 1e-6

    border = torch.linspace(-1, 1, cells)  # the corners' centres taken for the image's borders
    wrong = (0.3 * border[:, None] - 0.8 * border[None, :] + 0.1)[None]
    assert (
        np.abs(PolarBev(sectors, rings, 0.9, samples)(wrong)[0, 0].numpy() - expected).max() > 0.01
    )


@pytest.mark.parametrize(("reach", "samples"), [(1.0, 2), (0.7, 1), (1.0, 4)])
def test_it_is_the_mean_of_interpolated_samples(reach, samples):
    cells, sectors, rings = 40, 12, 15
    image = bev(cells)
    found = PolarBev(sectors, rings, reach, samples)(image)[:, 0].numpy()
    theta = (np.arange(sectors * samples) + 0.5) * 2 * np.pi / (sectors * samples)
    r = (np.arange(rings * samples) + 0.5) * reach * cells / 2 / (rings * samples)
    middle = (cells - 1) / 2
    where = [np.outer(np.cos(theta), r) + middle, np.outer(np.sin(theta), r) + middle]
    for one, given in zip(found, image.numpy().astype(float), strict=True):
        sampled = map_coordinates(np.pad(given, 1), [w + 1 for w in where], order=1)
        mean = sampled.reshape(sectors, samples, rings, samples).mean((1, 3))
        assert np.abs(one - mean).max() < 1e-5


def test_rows_and_rings_are_those_of_a_polar_gram():
    image = PolarBev(16, 20, samples=16)
    for azimuth, distance in ((0.1, 30.0), (1.75, 12.0), (4.1, 50.0)):
        place = [distance * math.cos(azimuth), distance * math.sin(azimuth), 1.0]
        point = np.array([place], np.float32)
        row, ring = np.argwhere(polar_gram(point, 70.0, 16, 20))[0]
        bev = torch.from_numpy(bev_occupancy(point)[None])
        seen = divmod(int(image(bev).argmax()), 20)
        assert seen[0] == row
        assert abs(seen[1] - ring) <= 1  # a cell is 1.2 m wide
        assert divmod(int(image(bev.mT).argmax()), 20)[0] != row  # azimuths from y, clockwise


def test_few_samples_miss_what_lies_between_them_far_out():
    cells = torch.eye(120 * 120).view(-1, 120, 120)[disc_mask(120).ravel().nonzero()[0][::7]]
    for samples, least, most in ((2, 0.01, 0.1), (4, 0.0, 0.0)):
        missed = (PolarBev(60, 60, samples=samples)(cells).sum((1, 2, 3)) == 0).float().mean()
        print(f"{samples} samples along each side: {missed:.3f} of the cells weigh nothing")
        assert least <= missed <= most


@pytest.mark.parametrize("step", [1, 2, 7])
def test_a_turn_of_the_points_shifts_it_and_the_sinogram_alike(step):
    rows, scan = 60, points()
    images = torch.from_numpy(
        np.stack([bev_occupancy(turned(scan, k * 2 * math.pi / rows)) for k in (step, 0)])
    )
    sinogram, polar = Sinogram(120, 120, 2)(images), PolarBev(rows, 60)(images)
    assert best_shift(polar[:1], polar[1:]) == best_shift(sinogram[:1], sinogram[1:]) == step
    other_way = PolarBev(rows, 60)(images.mT)  # azimuths from y, clockwise
    assert best_shift(other_way[:1], other_way[1:]) == -step
