"""What the projector shows: scans of map and queries, which no turn moves."""

import math

import numpy as np
import torch

from deepring.core.rigid import turn_points
from deepring.data.packed_rasters import Rasters, pack
from deepring.experiment import projector
from deepring.experiment.projector import _invariant, _main_axes, _pictures
from deepring.rasters import BevRaster, PolarRaster, Preprocessing
from helpers.networks import small_network


def rasters(raster, clouds):
    return Rasters(np.stack([pack(raster(cloud, 0.0), raster) for cloud in clouds]), raster)


def walls(x, y):
    """Points of the ground, and 3 m above them."""
    return np.concatenate([np.column_stack([x, y, z + 0 * x]) for z in (0, 3)])


def test_a_turned_scan_lies_where_it_did():
    network = small_network()
    line = np.linspace(-50, 50, 400)
    street = walls(line, 10 + 0 * line)
    yard = walls(20 * np.cos(line), 30 * np.sin(line) - 10)
    clouds = [street, yard, turn_points(street, math.pi / 2)]  # onto the cells of the raster
    scans = rasters(network.raster, clouds)
    vectors = _invariant(network, scans)
    apart = torch.cdist(vectors, vectors)
    assert apart[0, 2] < 0.1 * apart[0, 1]
    described = network.describe(scans[:]).flatten(1)
    assert torch.dist(described[0], described[2]) > 0.3 * torch.dist(described[0], described[1])


def test_few_axes_keep_the_distances_that_they_span(monkeypatch):
    monkeypatch.setattr(projector, "_AXES", 3)
    torch.manual_seed(0)
    flat = torch.randn(20, 3) @ torch.randn(3, 50) + 5  # of three dimensions, moved
    kept = _main_axes(flat)
    assert kept.shape == (20, 3)
    apart = torch.cdist(flat, flat)
    torch.testing.assert_close(torch.cdist(kept, kept), apart, rtol=1e-3, atol=1e-3)
    few = torch.randn(4, 2)
    assert _main_axes(few) is few


def test_pictures_are_of_scans_from_above_alone():
    above = BevRaster(cells=40, preprocessing=Preprocessing(clearance=None))
    cloud = np.array([[30.0, 0.0, 2.0]])
    (picture,) = _pictures(rasters(above, [cloud]))
    assert picture.shape == (1, 32, 32)
    assert (picture == 0).sum() in (1, 2, 4)  # black on white; a cell may lie in two pixels
    assert _pictures(rasters(PolarRaster(), [cloud])) is None
