"""Representations: shapes, scale, and rows that roll, also after pooling."""

import math

import numpy as np
import pytest
import torch

from deepring.core.equivariance import (
    EquivarianceError,
    assert_equivariant,
    assert_theta_equivariant,
)
from deepring.core.radon import radon
from deepring.errors import DeepringError
from deepring.nn.representation import PolarImage, Sinogram, make_representation
from deepring.rasters import BevRaster, ContextRaster, HeightRaster, PolarRaster, RangeRaster
from deepring.rasters.bev import disc_mask


def bev(cells=40, batch=2):
    occupied = torch.rand(batch, cells, cells, generator=torch.Generator().manual_seed(0)) > 0.9
    return (occupied & torch.from_numpy(disc_mask(cells).copy())).to(torch.uint8)


@pytest.mark.parametrize(("angles", "bins", "pool"), [(120, 120, 1), (120, 60, 2), (48, 40, 4)])
def test_sinogram_shapes(angles, bins, pool):
    representation = Sinogram(angles, bins, pool)
    out = representation(bev())
    assert out.shape == (2, 1, angles // pool, bins // pool)
    assert out.dtype == torch.float32
    assert representation.rows == angles // pool
    assert not list(representation.parameters())


@pytest.mark.parametrize("pool", [1, 2])
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_quarter_turn_of_the_bev_rolls_a_quarter_of_the_rows(quarters, pool):
    def theta_range(x):
        return torch.rot90(x, quarters, dims=(1, 2))

    rows = 48 // pool
    assert_equivariant(
        Sinogram(48, 40, pool), bev(), theta_range, lambda s: s.roll(quarters * rows // 4, dims=2)
    )
    if quarters != 2:  # half a turn is the same either way
        with pytest.raises(EquivarianceError):
            assert_equivariant(
                Sinogram(48, 40, pool),
                bev(),
                theta_range,
                lambda s: s.roll(-quarters * rows // 4, 2),
            )


def test_pooling_averages_rows_and_bins():
    pooled, full = Sinogram(48, 40, 4)(bev()), radon(bev(), 48, 40)
    assert torch.allclose(pooled[:, 0], full.reshape(2, 12, 4, 10, 4).mean((2, 4)), atol=1e-6)


@pytest.mark.parametrize("pool", [2, 3])
def test_pooling_keeps_the_rolls_that_it_divides(pool):
    x = torch.rand(2, 12, 6, generator=torch.Generator().manual_seed(1))
    image = PolarImage(12, 6, pool)
    assert_theta_equivariant(image, x, 2 * pool, 2)
    with pytest.raises(EquivarianceError):
        assert_theta_equivariant(image, x, 1, 1)


def test_values_are_shares_of_half_a_line_through_the_centre():
    full = torch.from_numpy(disc_mask(120).copy())[None]
    out = Sinogram()(full)
    assert out.min() >= 0
    assert out[0, 0, :, 60].sub(2.0).abs().max() < 0.08  # a full line is two halves
    assert Sinogram()(bev(120)).max() < 1.0


@pytest.mark.parametrize("pool", [1, 2])
def test_polar_images_are_floats_with_the_rows_of_the_raster(pool):
    raster = torch.randint(0, 2, (3, 12, 8), dtype=torch.uint8)
    out = PolarImage(12, 8, pool)(raster)
    assert out.shape == (3, 1, 12 // pool, 8 // pool)
    assert out.dtype == torch.float32
    assert out.mean().item() == pytest.approx(raster.float().mean().item())
    half = PolarImage(12, 8)(raster.to(torch.float16))
    assert half.dtype == torch.float32


@pytest.mark.parametrize(
    ("raster", "kind", "rows"),
    [
        (BevRaster(cells=40), Sinogram, 48),
        (PolarRaster(24, 10), PolarImage, 24),
        (RangeRaster(36, 8), PolarImage, 36),
        (ContextRaster(), PolarImage, 60),
    ],
)
def test_each_raster_gets_its_representation(raster, kind, rows):
    own = {"angles": 48, "bins": 40} if kind is Sinogram else {"angles": None, "bins": None}
    representation = make_representation(raster, **own)
    assert isinstance(representation, kind)
    points = np.random.default_rng(0).uniform(-40, 40, (3000, 3)).astype(np.float32)
    image = raster(points, 0.0)
    image = image.astype(np.uint8) if image.dtype == np.bool_ else image
    out = representation(torch.from_numpy(image)[None])
    assert out.shape[:3] == (1, 1, rows)
    assert representation.rows == rows
    assert out.max() > 0
    assert math.isfinite(out.sum())


@pytest.mark.parametrize(
    ("match", "make"),
    [
        ("pool", lambda: Sinogram(120, 120, 7)),
        ("pool", lambda: Sinogram(120, 50, 4)),
        ("pool", lambda: Sinogram(120, 120, 0)),
        ("angles", lambda: Sinogram(7, 120)),
        ("angles", lambda: Sinogram(0, 120)),
        ("pool", lambda: PolarImage(120, 120, 7)),
        ("pool", lambda: PolarImage(120, 120, 0)),
        ("pool", lambda: PolarImage(120, 31, 2)),
        ("angles", lambda: make_representation(PolarRaster(), angles=60, bins=None)),
        ("angles", lambda: make_representation(BevRaster(), angles=None)),
        ("HeightRaster", lambda: make_representation(HeightRaster())),
    ],
)
def test_bad_arguments_are_named(match, make):
    with pytest.raises(DeepringError, match=rf"representation.*{match}"):
        make()
