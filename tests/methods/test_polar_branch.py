"""A polar branch beside the sinogram: one descriptor, one correlation, one yaw."""

import math

import numpy as np
import pytest
import torch

from deepring.core.correlation import correlation_curves, unit_norm
from deepring.core.equivariance import relative_error
from deepring.errors import DeepringError
from deepring.methods.deepring import DeepRing, DeepRingSettings
from deepring.methods.deepring.polar_branch import PolarSettings
from deepring.methods.deepring.real_form import RealDeepRing
from deepring.methods.network_file import (
    describe_network,
    make_network,
    weights_of,
)
from deepring.rasters import BevRaster, PolarRaster, raster_settings
from deepring.rasters.bev import disc_mask
from helpers.networks import deepring_settings

CELLS, ROWS, RINGS = 32, 32, 12
SMALL = PolarSettings(widths=(4, 6), rings=RINGS)


def settings(polar=SMALL, **changes):
    values = {"angles": 2 * ROWS, "bins": 2 * CELLS, "pool": 2, "widths": (4, 6)}
    raster = raster_settings(BevRaster(cells=CELLS))
    return deepring_settings(
        **{"raster": raster, **values, "convolutions": 1, "polar": polar, **changes}
    )


def network(**changes):
    """With batch statistics that are not the initial ones, in evaluation mode."""
    torch.manual_seed(0)
    net = DeepRing(settings(**changes))
    with torch.no_grad():
        for seed in range(3):
            net(scans(8, seed))
    return net.eval()


def scans(n=3, seed=9):
    occupied = torch.rand(n, CELLS, CELLS, generator=torch.Generator().manual_seed(seed)) > 0.85
    return (occupied & torch.from_numpy(disc_mask(CELLS).copy())).to(torch.uint8)


PAIRS = {"aggregation": "cross_spectra", "gaps": [22.5], "frequencies": 6}


@pytest.mark.parametrize(
    "changes", [{}, PAIRS, {"aggregation": "gap"}, {"pool": 1, "stem": 2}, {"polar": None}]
)
def test_the_shape_of_a_descriptor(changes):
    net = network(**changes)
    out = net.describe(scans())
    assert out.shape == (3, *net.descriptor_shape)
    assert net.descriptor_shape[0] == ROWS
    assert out.square().sum((1, 2)).sub(1).abs().max() < 1e-5


def test_without_it_the_network_is_that_of_before():
    plain, both = network(polar=None), network()
    assert not [name for name in plain.state_dict() if name.startswith("polar")]
    assert plain.polar is None
    shared = {k: v for k, v in both.state_dict().items() if not k.startswith("polar.")}
    assert shared.keys() == plain.state_dict().keys()
    assert all(torch.equal(shared[name], value) for name, value in plain.state_dict().items())
    width = plain.descriptor_shape[1]
    first = both.describe(scans())[..., :width]
    assert relative_error(first, plain.describe(scans()) * math.sqrt(0.8)) < 1e-6


def test_settings_from_before_have_none():
    values = settings(polar=None).to_dict()
    del values["polar"]
    assert DeepRingSettings.from_dict(values) == settings(polar=None)


def test_the_settings_and_weights_travel():
    net = network(polar=PolarSettings(widths=(4,), rings=8, radius=35, samples=3, share=0.4))
    again = make_network(describe_network(net), weights_of(net))
    assert again.settings == net.settings
    assert again.settings.to_dict()["polar"]["widths"] == [4]
    assert torch.equal(again.describe(scans()), net.describe(scans()))


@pytest.mark.parametrize("share", [0.2, 0.7])
@pytest.mark.parametrize("normalisation", ["unit", "standard"])
def test_the_curves_of_both_parts_add_before_the_maximum(share, normalisation):
    polar = PolarSettings(widths=(4, 6), rings=RINGS, share=share)
    net = network(polar=polar, normalisation=normalisation)
    assert net.polar.share.item() == pytest.approx(share)
    queries, entries = scans(4, 1), scans(5, 2)
    with torch.no_grad():

        def parts(images):
            sinogram = net.normalise(net.aggregate(net.encoder(net.representation(images))))
            return sinogram.double().numpy(), net.normalise(net.polar(images)).double().numpy()

        (qs, qp), (ds, dp) = parts(queries), parts(entries)
        found = net.compare(net.describe(queries), net.describe(entries))

    for i, k in np.ndindex(4, 5):
        both = (1 - share) * curve(qs[i], ds[k]) + share * curve(qp[i], dp[k])
        assert float(found.score[i, k]) == pytest.approx(both.max(), abs=1e-5)
        turn = float(found.turn[i, k]) * ROWS / (2 * math.pi)
        assert both[round(turn) % ROWS] == pytest.approx(both.max(), abs=1e-6)


def curve(query, entry):
    """Correlation at every turn, by definition."""
    return np.array([(np.roll(query, -shift, axis=0) * entry).sum() for shift in range(ROWS)])


def test_two_maxima_at_two_turns_would_be_another_score():
    branch, draw = network().polar, torch.Generator().manual_seed(0)
    parts = [unit_norm(torch.randn(2, ROWS, 4, generator=draw)) for _ in range(2)]
    with torch.no_grad():
        both = branch.joined(*parts)
    first, second = (curve(*part.double().numpy()) for part in parts)
    score = correlation_curves(both[:1], both[1:]).max()
    assert float(score) == pytest.approx((0.8 * first + 0.2 * second).max(), abs=1e-5)
    assert 0.8 * first.max() + 0.2 * second.max() > float(score) + 0.01


@pytest.mark.parametrize("changes", [{}, PAIRS])
def test_quarter_turns_are_found_and_change_nothing(changes):
    net = network(**changes)
    plain = net.describe(scans())
    for quarters in (1, 3):
        turned = net.describe(torch.rot90(scans(), quarters, dims=(1, 2)))
        assert relative_error(turned, plain.roll(quarters * ROWS // 4, dims=1)) < 1e-3
        match = net.compare(turned, plain)
        expected = math.remainder(quarters * math.pi / 2, 2 * math.pi)
        assert torch.allclose(match.turn.diagonal(), torch.full((3,), expected), atol=1e-4)
        assert torch.allclose(match.score.diagonal(), torch.ones(3), atol=1e-4)


def test_the_index_finds_what_the_comparison_finds():
    net = network()
    entries, queries = net.describe(scans(20, 3)), net.describe(scans(4, 4))
    index = net.index()
    index.add(entries)
    hits = index.search(queries, 3)
    match = net.compare(queries, entries)
    best = match.score.topk(3)
    assert hits.place.tolist() == best.indices.tolist()
    assert torch.allclose(hits.score, best.values, atol=1e-4)


def test_the_share_and_both_networks_are_learned():
    torch.manual_seed(0)
    net = DeepRing(settings())
    one, other = net(scans(6, 1)), net(scans(6, 2))
    correlation_curves(one, other).amax(-1).diagonal().sum().backward()
    for name, weight in net.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all()
    assert net.polar.logit.grad != 0


def test_an_empty_scan_gives_a_finite_descriptor():
    assert torch.isfinite(network().describe(torch.zeros(1, CELLS, CELLS))).all()


def test_what_lies_beyond_the_radius_is_not_seen():
    near = network(polar=PolarSettings(widths=(4,), rings=RINGS, radius=30.0))
    image = scans(1)
    offset = torch.arange(CELLS) - (CELLS - 1) / 2
    far = torch.hypot(offset[:, None], offset[None, :]) * 140 / CELLS > 30 + 2 * 140 / CELLS
    with torch.no_grad():
        assert torch.equal(near.polar(image), near.polar(image * ~far))
    assert not torch.equal(network().polar(image), network().polar(image * ~far))


@pytest.mark.parametrize(
    ("match", "changes"),
    [
        (r"similarity\.kind: 'l2' with a polar branch", {"similarity": "l2"}),
        (
            r"similarity\.kind: 'cosine' with a polar branch",
            {"similarity": "cosine", "aggregation": "dft2"},
        ),
        (r"similarity\.normalisation: 'none' with", {"normalisation": "none"}),
        (r"theta_range: 'half' with a polar branch", {"theta_range": "half"}),
        (
            r"polar: a second look at a PolarRaster",
            {"raster": raster_settings(PolarRaster(64, 32)), "angles": None, "bins": None},
        ),
        (r"polar\.share: 0", {"polar": PolarSettings(share=0)}),
        (r"polar\.share: 1", {"polar": PolarSettings(share=1.0)}),
        (r"polar\.rings: 0", {"polar": PolarSettings(rings=0)}),
        (r"polar\.samples: 0", {"polar": PolarSettings(samples=0)}),
        (r"polar\.samples: 64 .*16777216", {"polar": PolarSettings(rings=4096, samples=64)}),
        (r"polar\.radius: 71", {"polar": PolarSettings(radius=71.0)}),
        (r"polar\.widths: \[\]", {"polar": PolarSettings(widths=())}),
        (r"polar\.widths: 3 levels .* 32 x 13", {"polar": PolarSettings(rings=13)}),
        (r"polar\.norm: 'layer'", {"polar": PolarSettings(norm="layer")}),
        (r"polar\.convolutions: 0", {"polar": PolarSettings(convolutions=0)}),
    ],
)
def test_bad_settings_are_named(match, changes):
    with pytest.raises(DeepringError, match=match):
        DeepRing(settings(**changes))


@pytest.mark.parametrize("changes", [{}, PAIRS, {"pool": 1, "stem": 2}])
def test_real_arithmetic_is_the_network(changes):
    net = network(**changes)
    with torch.no_grad():
        found = RealDeepRing(net)(scans(5).float())
    assert torch.allclose(found, net.describe(scans(5)), atol=1e-5)


def test_both_parts_have_the_same_norm_before_their_shares():
    net = network()
    out = net.describe(scans())
    width = net.descriptor_shape[1] - RINGS
    norms = [part.square().sum((1, 2)) for part in (out[..., :width], out[..., width:])]
    assert torch.allclose(norms[0], torch.full((3,), 0.8), atol=1e-5)
    assert torch.allclose(norms[1], torch.full((3,), 0.2), atol=1e-5)
    assert relative_error(unit_norm(out), out) < 1e-5
