"""Every method's index finds what its own comparison finds."""

import pytest
import torch

from deepring.methods.deepring import DeepRing
from deepring.methods.disco import Disco, DiscoSettings
from deepring.methods.method import Comparison, index_of
from deepring.methods.ring import Ring
from deepring.methods.ring_plus_plus import RingPlusPlus
from deepring.methods.scan_context import ContextIndex, ScanContext
from deepring.rasters import (
    BevRaster,
    ContextRaster,
    FeatureBevRaster,
    HeightRaster,
    raster_settings,
)
from deepring.search.compare_index import CompareIndex
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.vector_index import VectorIndex
from helpers.networks import deepring_settings


def bevs(n, seed):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(n, 40, 40, generator=generator) < 0.1


def heights(shape):
    def make(n, seed):
        generator = torch.Generator().manual_seed(seed)
        values = torch.rand(n, *shape, generator=generator)
        return torch.where(values > 0.5, values * 8, 0.0)

    return make


def layers(n, seed):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(n, 4, 16, 16, generator=generator) < 0.1


def features(n, seed):
    return bevs(6 * n, seed).float().view(n, 6, 40, 40)


def deepring(**settings):
    torch.manual_seed(0)
    raster = raster_settings(BevRaster(cells=40))
    return DeepRing(
        deepring_settings(raster, angles=40, bins=40, widths=(4,), convolutions=1, **settings)
    )


def disco():
    torch.manual_seed(0)
    raster = raster_settings(HeightRaster(layers=4, sectors=16, rings=16))
    return Disco(DiscoSettings(raster=raster, widths=(4, 8), size=8, aligned=None))


class Own:
    """A method of one's own: compares by the number of occupied cells."""

    raster = BevRaster(cells=40)

    def describe(self, rasters):
        return rasters.flatten(1).sum(dim=1, keepdim=True).float()

    def compare(self, queries, database):
        return Comparison(-(queries - database.T).abs(), None)


METHODS = {
    "deepring": (deepring, bevs, CorrelationIndex),
    "deepring half": (lambda: deepring(theta_range="half"), bevs, CorrelationIndex),
    "deepring l2": (lambda: deepring(similarity="l2", aggregation="dft2"), bevs, VectorIndex),
    "deepring cosine": (lambda: deepring(similarity="cosine"), bevs, VectorIndex),
    "ring": (lambda: Ring(BevRaster(cells=40), 40, 40), bevs, CorrelationIndex),
    "ring published": (
        lambda: Ring(BevRaster(cells=40), 40, 40, "published"),
        bevs,
        CompareIndex,
    ),
    "ring++": (
        lambda: RingPlusPlus(FeatureBevRaster(cells=40), 40, 40),
        features,
        CorrelationIndex,
    ),
    "scan context": (
        lambda: ScanContext(ContextRaster(12, 6)),
        heights((12, 6)),
        ContextIndex,
    ),
    "scan context, candidates": (
        lambda: ScanContext(ContextRaster(12, 6), candidates=5),
        heights((12, 6)),
        ContextIndex,
    ),
    "disco": (disco, layers, VectorIndex),
    "own": (Own, bevs, CompareIndex),
}


@pytest.mark.parametrize("name", METHODS)
def test_the_index_finds_what_compare_finds(name):
    make, images, kind = METHODS[name]
    method = make()
    database, queries = method.describe(images(30, 1)), method.describe(images(4, 2))
    index = index_of(method)
    assert type(index) is kind
    index.add(database[:11])
    index.add(database[11:])
    assert len(index) == 30
    expected = method.compare(queries, database)
    hits = index.search(queries, k=5)
    assert torch.allclose(hits.score, expected.score.topk(5).values, atol=2e-5)
    assert torch.allclose(hits.score, expected.score.gather(1, hits.place), atol=2e-5)
    if expected.turn is None:
        assert hits.turn is None
    else:
        # RING's correlation has two equal peaks half a turn apart.
        symmetry = 2 if name.startswith("ring") else 1
        apart = symmetry * (hits.turn - expected.turn.gather(1, hits.place))
        assert torch.allclose(torch.cos(apart), torch.ones_like(apart))


class Halved(Ring):
    """A user's subclass that compares otherwise."""

    def compare(self, queries, database):
        score, turn = super().compare(queries, database)
        return Comparison(score / 2, turn)


class Named(Ring):
    """A user's subclass that compares as its base does."""


def test_a_subclass_that_compares_otherwise_does_not_inherit_the_index():
    arguments = (BevRaster(cells=40), 40, 40)
    assert type(index_of(Halved(*arguments))) is CompareIndex
    assert type(index_of(Named(*arguments))) is CorrelationIndex
