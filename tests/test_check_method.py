"""Every method passes `check_method`, and methods that are wrong in one way fail for that."""

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import pytest
import torch
from torch import nn

from deepring.core.similarity import negative_distance
from deepring.methods.m2dp import M2dp
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.methods.network_file import load_network
from deepring.methods.registry import registered_methods
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.methods.scan_context_plus_plus import CartContext, PolarContext
from deepring.rasters import (
    CartContextRaster,
    M2dpRaster,
    PolarContextRaster,
    PolarRaster,
    raster_settings,
)
from deepring.search.compare_index import CompareIndex
from deepring.search.hits import Hits
from deepring.testing import MethodError, check_method, rasterize, walls
from helpers.tiny_methods import BEV, CONTEXT, TINY, deepring, disco

TURNLESS = (
    "pointnetvlad",
    "egonn",
    "fast_histogram",
    "m2dp",
    "cart_context",
    "locnet",
    "rinet",
    "lcdnet",
    "lpdnet",
    "dh3d",
    "locus",
)
WITHOUT_TURN = {"turn": "compare returns no turn"}


def polar_context():
    raster = PolarContextRaster(sectors=24, rings=8, sideways=(0, 2, -2))
    return PolarContext(raster, candidates=3)


def cart_context():
    return CartContext(CartContextRaster(reverse=True), candidates=None, window=0.3)


VARIANTS = {
    "DeepRING over half a turn": (lambda: deepring(theta_range="half"), {}),
    "DeepRING by L2": (lambda: deepring(similarity="l2", aggregation="dft2"), WITHOUT_TURN),
    "DeepRING by cosine": (lambda: deepring(similarity="cosine"), WITHOUT_TURN),
    "RING as published": (lambda: Ring(BEV, 24, 24, "published"), {}),
    "Scan Context, 3 candidates": (lambda: ScanContext(CONTEXT, candidates=3), {}),
    "M2DP, 4 signs": (lambda: M2dp(M2dpRaster(signs=4)), WITHOUT_TURN),
    "Scan Context++, 3 candidates from 3 origins": (polar_context, {}),
    "Cart Context, both ways": (cart_context, WITHOUT_TURN),
    "DiSCO, all aligned": (lambda: disco(aligned=None), {}),
    "the shipped network": (lambda: load_network("shipped").method, {}),
}


@pytest.mark.parametrize("name", registered_methods())
def test_every_registered_method_passes(name):
    skipped = check_method(TINY[name]())
    assert skipped == (WITHOUT_TURN if name in TURNLESS else {})


@pytest.mark.parametrize("name", VARIANTS)
def test_their_variants_pass(name):
    make, skipped = VARIANTS[name]
    assert check_method(make(), seed=3) == skipped


def test_rasters_of_ones_own_are_taken():
    method = ScanContext(CONTEXT)
    rasters = rasterize(method, [walls(k) for k in range(20, 24)])
    assert check_method(method, rasters) == {}
    with pytest.raises(MethodError, match="rasters: 2 scans, expected at least 3"):
        check_method(method, rasters[:2])
    with pytest.raises(MethodError, match=r"shapes: rasters \(4, 24, 7\), expected \(n, 24, 8"):
        check_method(method, rasters[:, :, :7])


class Right:
    """Scan Context, as a user would write it who states nothing but the three calls."""

    raster = CONTEXT

    def describe(self, rasters):
        return rasters.float()

    def compare(self, queries, database):
        return ScanContext(CONTEXT).compare(queries, database)


def test_a_user_s_method_of_three_calls_passes():
    skipped = check_method(Right())
    assert list(skipped) == ["file"]
    assert "from_fingerprint" in skipped["file"]


def wrong(**members):
    """`Right`, but for these members."""
    return type("Wrong", (Right,), members)()


def with_compare(change):
    """A ``compare`` whose score and turn are changed."""

    def compare(self, queries, database):
        return Comparison(*change(*Right.compare(self, queries, database)))

    return compare


def with_describe(change):
    """A ``describe`` whose descriptors are changed."""
    return lambda self, rasters: change(Right.describe(self, rasters))


class Lossy(CompareIndex):
    """Forgets all but the first places."""

    def add(self, descriptors):
        if not len(self):
            super().add(descriptors)


class Changed(CompareIndex):
    """Hits that are changed."""

    def __init__(self, method, change):
        super().__init__(method)
        self.change = change

    def search(self, queries, k=1):
        return self.change(super().search(queries, k))


def with_index(change):
    """An ``index`` whose hits are changed."""
    return lambda self, _: Changed(self, change)


def refuse(self, rasters):
    if not len(rasters):
        raise ValueError("no rasters")
    return rasters.float()


class Forgetful(Ring):
    """Its fingerprint says nothing of what its comparison depends on."""

    def __init__(self, raster=None, angles=24, bins=24, correlation="paper"):
        super().__init__(raster, angles, bins, correlation)
        self._scale = 1.0

    def compare(self, queries, database):
        score, turn = super().compare(queries, database)
        return Comparison(score * self._scale, turn)

    def index(self, _):
        return CompareIndex(self)


class Default(Ring):
    """Is rebuilt with other values than it was made with."""

    @classmethod
    def from_fingerprint(cls, _):
        return cls(BEV, 24, 12)


def forgetful():
    method = Forgetful(BEV)
    method._scale = 0.5
    return method


@dataclass(frozen=True)
class LinearSettings(PlainSettings):
    label: ClassVar[str] = "Linear"
    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(PolarRaster(24, 16)))


class Linear(NetworkMethod):
    """A network of a user; ``offset`` is a weight that its state does not hold."""

    settings_class = LinearSettings

    def __init__(self, settings=None):
        super().__init__(settings or LinearSettings())
        self.layer = nn.Linear(16, 8)
        self.offset = 0.0

    def forward(self, rasters):
        return self.layer(rasters.float()).relu().mean(dim=1) + self.offset

    def compare(self, queries, database):
        return Comparison(negative_distance(queries, database), None)


class Unsteady(Linear):
    """Batch norm that stays in training mode: a scan is described by the others of its batch."""

    def __init__(self, settings=None):
        super().__init__(settings)
        self.norm = nn.BatchNorm1d(8, track_running_stats=False)

    def forward(self, rasters):
        values = super().forward(rasters)
        return values - values.mean(dim=0) if len(values) > 1 else values


def biased():
    torch.manual_seed(0)
    method = Linear()
    method.offset = 1.0
    return method


def test_a_network_of_a_user_passes():
    torch.manual_seed(0)
    assert check_method(Linear()) == WITHOUT_TURN


WRONG = {
    "whole numbers": (
        wrong(describe=with_describe(lambda d: d.long())),
        r"shapes: describe returns torch\.int64, expected a Tensor of torch\.float32",
    ),
    "twice the precision": (
        wrong(describe=with_describe(lambda d: d.double())),
        r"shapes: describe returns torch\.float64, .*, which is all that files of descriptors hold",
    ),
    "half the precision": (
        wrong(describe=with_describe(lambda d: d.half())),
        r"shapes: describe returns torch\.float16, expected a Tensor of torch\.float32",
    ),
    "no tensor": (
        wrong(describe=with_describe(lambda d: d.numpy())),
        "shapes: describe returns ndarray, expected a Tensor",
    ),
    "one descriptor for all": (
        wrong(describe=with_describe(lambda d: d.mean(dim=0, keepdim=True))),
        r"shapes: describe returns \(1, 24, 8\) for 8 rasters, expected \(8, \.\.\.\)",
    ),
    "not finite": (
        wrong(describe=with_describe(lambda d: d / 0.0)),
        r"shapes: \d+ of 1536 numbers are not finite",
    ),
    "scores transposed": (
        wrong(compare=with_compare(lambda score, turn: (score.T, turn))),
        r"shapes: compare returns a score of \(8, 2\) for 2 queries and 8 entries, expected \(2, 8",
    ),
    "one turn per query": (
        wrong(compare=with_compare(lambda score, turn: (score, turn[:, 0]))),
        r"shapes: compare returns a turn of \(2,\)",
    ),
    "whole turns": (
        wrong(compare=with_compare(lambda score, turn: (score, turn.long()))),
        "shapes: turn of compare, expected a floating Tensor",
    ),
    "scores that are no numbers": (
        wrong(compare=with_compare(lambda score, turn: (score / 0, turn))),
        "shapes: 16 scores are not finite",
    ),
    "turns in degrees": (
        wrong(compare=with_compare(lambda score, turn: (score, torch.rad2deg(turn)))),
        r"shapes: a turn of \d+\.\d+, expected \[-π, π\]",
    ),
    "noise": (
        wrong(describe=with_describe(lambda d: d + torch.rand_like(d))),
        "determinism: described twice, descriptors differ by",
    ),
    "the batch counts": (Unsteady(), "determinism: described one at a time, descriptors differ"),
    "no empty batch": (
        wrong(describe=refuse),
        r"empty batch: describe raises ValueError for 0 rasters, expected \(0, 24, 8\)",
    ),
    "an empty batch of another shape": (
        wrong(describe=lambda _, rasters: rasters.float() if len(rasters) else torch.empty(0)),
        r"empty batch: describe returns \(0,\) for 0 rasters, expected \(0, 24, 8\)",
    ),
    "no comparison with nothing": (
        wrong(compare=with_compare(lambda score, turn: (score + 0 * score.max(), turn))),
        r"empty batch: compare raises \w+ for 0 queries and 8 entries, expected scores \(0, 8\)",
    ),
    "a distance for a score": (
        wrong(compare=with_compare(lambda score, turn: (1 - score, turn))),
        r"self-similarity: scan \d scores .* with itself and 0\.\d+ with scan \d",
    ),
    "all scans alike": (
        wrong(describe=with_describe(torch.ones_like)),
        "self-similarity: a scan scores .* with all 8 scans",
    ),
    "one pose for all places": (
        wrong(relative_poses=lambda *_: torch.eye(4, dtype=torch.float64)[None]),
        r"relative poses: torch\.float64 \(1, 4, 4\) for 2 places, expected float64 \(2, 4, 4\)",
    ),
    "poses that stretch": (
        wrong(
            relative_poses=lambda _, __, places: 2 * torch.eye(4).double().repeat(len(places), 1, 1)
        ),
        r"relative poses: \[\[\[2\.0.* expected rigid transforms, or NaN throughout",
    ),
    "the opposite turn": (
        wrong(compare=with_compare(lambda score, turn: (score, -turn))),
        r"turn: the points were turned by 60° .*\[-60.*of the opposite sign",
    ),
    "no turn at all": (
        wrong(compare=with_compare(lambda score, turn: (score, 0 * turn))),
        r"turn: .*returns \[0, 0, 0, 0, 0, 0, 0, 0\] degrees; expected most of them within 25°",
    ),
    "half a turn more": (
        wrong(compare=with_compare(lambda s, turn: (s, (turn % (2 * math.pi)) - math.pi))),
        r"turn: .*\[-120, .*modulo 360°",
    ),
    "places are lost": (
        wrong(index=lambda self, _: Lossy(self)),
        "index: holds 4 of 8 places that were added",
    ),
    "other scores": (
        wrong(index=with_index(lambda hits: hits._replace(score=hits.score / 2))),
        "index: the best 8 scores differ by 0.5",
    ),
    "worst first": (
        wrong(index=with_index(lambda hits: Hits(*(values.flip(1) for values in hits)))),
        "index: the best 8 scores differ",
    ),
    "other places": (
        wrong(index=with_index(lambda hits: hits._replace(place=hits.place.flip(1)))),
        "index: the scores of its places differ by",
    ),
    "another turn": (
        wrong(index=with_index(lambda hits: hits._replace(turn=hits.turn + 0.1))),
        "index: the turn of the best place differs by 0.1 rad",
    ),
    "the turn is lost": (
        wrong(index=with_index(lambda hits: hits._replace(turn=None))),
        "index: compare returns turns, but the index does not",
    ),
    "a weight outside the state": (biased(), "file: read from a file, the network .* differ by"),
    "a value outside the fingerprint": (
        forgetful(),
        "file: rebuilt from its fingerprint, scores differ by 1,",
    ),
    "rebuilt as another": (
        Default(BEV, 24, 24),
        "file: rebuilt from its fingerprint, values.bins is 12, expected 24",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_method_is_told_what_is_wrong(name):
    method, message = WRONG[name]
    with pytest.raises(MethodError, match=f"^{message}"):
        check_method(method)


def test_half_a_turn_more_is_none_for_a_method_that_says_so():
    more, _ = WRONG["half a turn more"]
    more.turn_period = math.pi
    assert list(check_method(more)) == ["file"]


def test_every_property_is_failed_by_a_method():
    failed = {message.partition(":")[0] for _, message in WRONG.values()}
    properties = [
        "shapes",
        "determinism",
        "empty batch",
        "self-similarity",
        "turn",
        "index",
        "relative poses",
    ]
    assert failed == {*properties, "file"}
