"""Every method's index finds what its own comparison finds."""

import pytest
import torch

from deepring.errors import DeepringError
from deepring.methods.base import Comparison
from deepring.methods.deepring import DeepRing
from deepring.methods.disco import Disco, DiscoSettings
from deepring.methods.index_for import index_for
from deepring.methods.ring import Ring
from deepring.methods.ring_plus_plus import RingPlusPlus
from deepring.methods.scan_context import ScanContext
from deepring.rasters.kinds import BevRaster, ContextRaster, HeightRaster, raster_settings
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
    "ring++": (lambda: RingPlusPlus(angles=40, bins=40), features, CorrelationIndex),
    "scan context": (
        lambda: ScanContext(ContextRaster(12, 6)),
        heights((12, 6)),
        None,
    ),
    "scan context, candidates": (
        lambda: ScanContext(ContextRaster(12, 6), candidates=5),
        heights((12, 6)),
        None,
    ),
    "disco": (disco, layers, VectorIndex),
    "own": (Own, bevs, CompareIndex),
}


@pytest.mark.parametrize("name", METHODS)
def test_the_index_finds_what_compare_finds(name):
    make, images, kind = METHODS[name]
    method = make()
    database, queries = method.describe(images(30, 1)), method.describe(images(4, 2))
    index = index_for(method)
    assert kind is None or isinstance(index, kind)
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


def test_close_neighbours_are_told_apart_in_batches():
    """FAISS's own L2 of many queries at once takes products, which cannot."""
    generator = torch.Generator().manual_seed(0)
    centre = torch.nn.functional.normalize(torch.randn(1, 64, generator=generator))
    database = centre + 1e-5 * torch.arange(200)[:, None] * torch.eye(64)[:1]
    index = VectorIndex("l2")
    index.add(database)
    assert index.search(database[:40]).place[:, 0].tolist() == list(range(40))
    assert index.search(database[:40]).score.abs().max() == 0


def test_vector_mistakes_are_named():
    index = VectorIndex("cosine")
    assert index.search(torch.zeros(2, 3)).place.shape == (2, 0)
    index.add(torch.rand(4, 3))
    with pytest.raises(DeepringError, match="5 numbers, but the places have 3"):
        index.search(torch.rand(1, 5))
    with pytest.raises(DeepringError, match="metric: 'dot'"):
        VectorIndex("dot")
