"""Looking up through a method's index gives the places that its comparison puts first."""

import pytest
import torch

from deepring.errors import DeepringError
from deepring.evaluation.look_up import fill_index, look_up
from deepring.methods.deepring import DeepRing
from deepring.methods.disco import Disco, DiscoSettings
from deepring.methods.method import Comparison
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.rasters import BevRaster, ContextRaster, HeightRaster, raster_settings
from helpers.networks import deepring_settings

BEV, CONTEXT = BevRaster(cells=24), ContextRaster(sectors=24, rings=8)
HEIGHTS = HeightRaster(layers=2, sectors=24, rings=16)


def network(cls, settings):
    torch.manual_seed(0)
    return cls(settings).eval()


METHODS = {
    "RING": lambda: Ring(BEV, angles=24, bins=24),
    "Scan Context": lambda: ScanContext(CONTEXT),
    "DeepRING": lambda: network(
        DeepRing,
        deepring_settings(raster=raster_settings(BEV), angles=24, bins=24, widths=(4, 6)),
    ),
    "DiSCO": lambda: network(
        Disco, DiscoSettings(raster=raster_settings(HEIGHTS), widths=(4, 6), size=8, aligned=None)
    ),
}


@pytest.fixture(params=METHODS)
def described(request):
    """A method, descriptors of 30 places drawn at random, and 12 queries near the first of them."""
    method = METHODS[request.param]()
    shape = method.describe(torch.zeros(1, *method.raster.shape, dtype=torch.uint8)).shape[1:]
    generator = torch.Generator().manual_seed(1)
    database = torch.rand(30, *shape, generator=generator)
    noise = torch.rand(12, *shape, generator=generator) - 0.5
    return method, database, (database[:12] + 0.1 * noise).clamp(min=0)


def test_places_scores_and_turns_are_those_of_the_comparison(described):
    method, database, queries = described
    hits, seconds = look_up(fill_index(method, database.split(7)), queries.split(5), 4)
    comparison = method.compare(queries, database)
    best = comparison.score.argsort(dim=1, descending=True, stable=True)[:, :4]
    assert torch.equal(hits.place, best)
    assert torch.equal(hits.place[:, 0], torch.arange(12))
    torch.testing.assert_close(hits.score, comparison.score.gather(1, best), rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(hits.turn, comparison.turn.gather(1, best))
    assert seconds > 0


@pytest.mark.parametrize("size", [1, 4, 12])
def test_batches_do_not_matter(described, size):
    method, database, queries = described
    whole, _ = look_up(fill_index(method, [database]), [queries])
    parts, _ = look_up(fill_index(method, database.split(size)), queries.split(size))
    assert torch.equal(whole.place, parts.place)
    assert torch.equal(whole.turn, parts.turn)


def test_of_equal_scores_the_place_that_came_first_is_first(described):
    method, database, _ = described
    twice = torch.cat([database, database])
    hits, _ = look_up(fill_index(method, twice.split(7)), database.split(11), 2)
    rows = torch.arange(len(database))
    assert torch.equal(hits.place, torch.stack([rows, rows + len(database)], dim=1))


def test_a_database_of_few_places_gives_as_many(described):
    method, database, queries = described
    hits, _ = look_up(fill_index(method, [database[:3]]), [queries])
    assert hits.place.shape == (12, 3)
    assert torch.equal(hits.place.sort(dim=1).values, torch.arange(3).expand(12, 3))


class Inverse:
    """A method whose scores are NaN where descriptors are 0."""

    raster = BEV

    def describe(self, rasters):
        return rasters

    def compare(self, queries, database):
        return Comparison(queries / queries * database.T, None)


def test_descriptors_and_scores_that_are_not_finite_are_refused():
    good, bad = torch.ones(4, 1), torch.tensor([[1.0], [torch.nan], [torch.inf]])
    with pytest.raises(DeepringError, match="of the database: 2 of 3 values are not finite"):
        fill_index(Inverse(), [good, bad])
    index = fill_index(Inverse(), [good])
    with pytest.raises(DeepringError, match="of the queries: 2 of 3 values are not finite"):
        look_up(index, [good, bad])
    with pytest.raises(DeepringError, match="scores: 4 NaN"):
        look_up(index, [good, torch.zeros(1, 1)])


def test_asking_for_more_places_changes_none_of_the_first(described):
    method, database, queries = described
    few, many = (look_up(fill_index(method, [database]), [queries], k)[0] for k in (5, 25))
    assert many.place.shape[1] > few.place.shape[1]
    for name in ("place", "score", "turn"):
        assert torch.equal(getattr(few, name), getattr(many, name)[:, : few.place.shape[1]])
