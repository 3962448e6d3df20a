"""DeepRING from raster to comparison: exact invariance, settings that travel, evaluation mode."""

import json
import math

import pytest
import torch

from deepring.core.equivariance import relative_error
from deepring.errors import DeepringError
from deepring.methods.deepring import NORMALISATIONS, DeepRing, DeepRingSettings
from deepring.methods.method import Method
from deepring.nn.aggregation import AGGREGATIONS
from deepring.rasters import BevRaster, HeightRaster, PolarRaster, RangeRaster, raster_settings
from deepring.rasters.bev import disc_mask
from helpers.networks import deepring_settings

CELLS = 32
PAIRS = {"gaps": [11.25, 22.5], "frequencies": 6}


def small(**changes):
    """Settings of a small network; angles and bins where the raster is a BEV."""
    raster = changes.get("raster", raster_settings(BevRaster(cells=CELLS)))
    bev = raster.get("kind") == "bev"
    values = {
        "raster": raster,
        "angles": 64 if bev else None,
        "bins": 32 if bev else None,
        "widths": (4, 6),
        "convolutions": 1,
    }
    return deepring_settings(**{**values, **changes})


def network(**changes):
    """With batch statistics that are not the initial ones, in evaluation mode."""
    torch.manual_seed(0)
    net = DeepRing(small(**changes))
    with torch.no_grad():
        for seed in range(3):
            net(scans(8, seed) if isinstance(net.raster, BevRaster) else noise(net, 8, seed))
    return net.eval()


def scans(n=3, seed=9):
    occupied = torch.rand(n, CELLS, CELLS, generator=torch.Generator().manual_seed(seed)) > 0.85
    return (occupied & torch.from_numpy(disc_mask(CELLS).copy())).to(torch.uint8)


def noise(net, n=3, seed=9):
    return torch.rand(n, *net.raster.shape, generator=torch.Generator().manual_seed(seed))


def quarter_turn(images, quarters=1):
    """The BEV of the scan turned counter-clockwise, indexed [x, y]."""
    return torch.rot90(images, quarters, dims=(1, 2))


def test_it_is_a_method():
    net = DeepRing(small())
    assert isinstance(net, Method)
    assert net.raster == BevRaster(cells=CELLS)
    assert net.describe(scans()).shape == (3, 64, 17)


@pytest.mark.parametrize("normalisation", NORMALISATIONS)
@pytest.mark.parametrize("aggregation", ["dft", "gap", "gmp", "multi_gap", "cross_spectra"])
@pytest.mark.parametrize(("pool", "widths"), [(1, (4, 6)), (2, (4, 6, 8))])
def test_quarter_turns_are_found_and_change_nothing(aggregation, normalisation, pool, widths):
    values = PAIRS if aggregation == "cross_spectra" else {}
    choice = {"aggregation": aggregation, "normalisation": normalisation, **values}
    net = network(pool=pool, widths=widths, **choice)
    plain = net.describe(scans())
    unturned = net.compare(plain, plain)
    for quarters in (1, 2, 3):
        turned = net.describe(quarter_turn(scans(), quarters))
        rows = plain.shape[1] * quarters // 4
        assert relative_error(turned, plain.roll(rows, dims=1)) < 1e-3
        score, turn = net.compare(turned, plain)
        assert relative_error(score, unturned.score) < 1e-4
    assert turn.shape == (3, 3)


def test_the_yaw_is_the_turn_of_the_points_modulo_the_sinograms_symmetry():
    net = network()
    plain = net.describe(scans(6))
    for quarters, theta_range in ((1, math.pi / 2), (3, -math.pi / 2)):
        turn = net.compare(net.describe(quarter_turn(scans(6), quarters)), plain).turn.diagonal()
        assert torch.allclose(
            turn, torch.full((6,), theta_range), atol=1e-4
        )  # not the other way round
        back = net.compare(plain, net.describe(quarter_turn(scans(6), quarters))).turn.diagonal()
        assert torch.allclose(back, torch.full((6,), -theta_range), atol=1e-4)


@pytest.mark.parametrize(("pool", "stride"), [(1, 2), (2, 2)])
def test_turns_by_the_stride_times_the_pool_are_exact_and_others_are_not(pool, stride):
    # A polar image is rolled exactly by a turn of any number of sectors, a BEV is not.
    raster = raster_settings(PolarRaster(sectors=48, rings=32))
    net = network(raster=raster, pool=pool)
    assert net.encoder.stride == stride
    images, exact = noise(net), stride * pool
    plain = net.describe(images)
    for sectors in (exact, 5 * exact, -exact):
        turned = net.describe(images.roll(sectors, dims=1))
        assert relative_error(turned, plain.roll(sectors // pool, dims=1)) < 1e-5
        score, turn = net.compare(turned, plain)
        assert torch.allclose(score.diagonal(), torch.ones(3), atol=1e-5)
        assert torch.allclose(
            turn.diagonal(), torch.full((3,), sectors * 2 * math.pi / 48), atol=1e-4
        )
    between = net.compare(net.describe(images.roll(1, dims=1)), plain).score.diagonal()
    print(f"1 - score after a turn by one of {exact} sectors: {(1 - between).tolist()}")
    assert (between < 1 - 1e-5).all()
    assert (between > 0.5).all()


def test_a_translation_along_tau_by_the_stride_changes_nothing():
    raster = raster_settings(PolarRaster(sectors=48, rings=32))
    net = network(raster=raster)
    images = noise(net)
    shifted = net.describe(images.roll(6, dims=2))
    assert relative_error(shifted, net.describe(images)) < 1e-5
    assert relative_error(net.describe(images.roll(1, dims=2)), net.describe(images)) > 1e-5


def test_scores_are_symmetric():
    net = network()
    one, other = net.describe(scans(3, 1)), net.describe(scans(4, 2))
    forth, back = net.compare(one, other), net.compare(other, one)
    assert torch.allclose(forth.score, back.score.T, atol=1e-5)


@pytest.mark.parametrize("kind", ["unit", "standard"])
def test_normalised_scores_are_one_with_oneself_and_at_most_one(kind):
    net = network(normalisation=kind)
    d = net.describe(scans(6))
    score = net.compare(d, d).score
    assert torch.allclose(score.diagonal(), torch.ones(6), atol=1e-5)
    assert score.max() <= 1 + 1e-5


def test_standard_also_takes_away_the_mean():
    d = network(normalisation="standard").describe(scans())
    assert torch.allclose(d.mean((1, 2)), torch.zeros(3), atol=1e-6)
    assert network(normalisation="unit").describe(scans()).mean() > 1e-3


def test_no_gradient_flows_from_descriptions():
    assert not network().describe(scans()).requires_grad
    assert network()(scans()).requires_grad


@pytest.mark.parametrize("training", [True, False])
def test_describe_leaves_the_mode_and_the_batch_statistics_as_they_are(training):
    net = network().train(training)
    before = {name: value.clone() for name, value in net.state_dict().items()}
    net.describe(scans())
    assert net.training is training
    assert all(module.training is training for module in net.modules())
    after = net.state_dict()
    assert all(torch.equal(after[name], value) for name, value in before.items())


def test_describe_restores_the_mode_after_an_error(monkeypatch):
    net = network().train()

    def fail(_):
        raise RuntimeError("out of memory")

    monkeypatch.setattr(net, "aggregate", fail)
    with pytest.raises(RuntimeError, match="out of memory"):
        net.describe(torch.zeros(2, CELLS, CELLS))
    assert net.training


def test_a_descriptor_does_not_depend_on_the_rest_of_its_batch():
    net = network().train()  # describe takes evaluation mode by itself
    together = net.describe(scans(5))
    alone = torch.cat([net.describe(scans(5)[k : k + 1]) for k in range(5)])
    assert relative_error(alone, together) < 1e-6
    with torch.no_grad():  # in training mode batch norm mixes the batch
        assert relative_error(net(scans(5))[:1], net(scans(5)[:1])) > 1e-3


def test_an_empty_scan_gives_a_finite_descriptor():
    assert torch.isfinite(network().describe(torch.zeros(1, CELLS, CELLS))).all()


@pytest.mark.parametrize(
    "settings",
    [
        DeepRingSettings(),
        small(aggregation="gap", normalisation="none", norm="group", tau_padding="zero", pool=2),
        small(raster=raster_settings(RangeRaster(sectors=48, rows=16))),
    ],
)
def test_settings_round_trip_as_plain_values(settings):
    values = settings.to_dict()
    assert DeepRingSettings.from_dict(values) == settings
    assert isinstance(values["encoder"]["widths"], list)
    through_json = DeepRingSettings.from_dict(json.loads(json.dumps(values)))
    assert json.dumps(through_json.to_dict()) == json.dumps(values)


def test_a_network_of_the_same_settings_takes_the_weights():
    net = network(norm="group", pool=2)
    twin = DeepRing(DeepRingSettings.from_dict(net.settings.to_dict())).eval()
    twin.load_state_dict(net.state_dict())
    assert twin.raster == net.raster
    assert torch.equal(twin.describe(scans()), net.describe(scans()))


def test_settings_that_do_not_exist_are_named():
    with pytest.raises(DeepringError, match="widhts"):
        DeepRingSettings.from_dict({"widhts": [4, 8]})


@pytest.mark.parametrize(
    ("match", "changes"),
    [
        (r"similarity\.normalisation: 'l2'", {"normalisation": "l2"}),
        (r"aggregation\.kind: 'max'", {"aggregation": "max"}),
        (r"raster\.kind", {"raster": {"kind": "cubes"}}),
        (r"raster\.kind", {"raster": {}}),
        ("HeightRaster", {"raster": raster_settings(HeightRaster())}),
        (r"representation\.pool: 7", {"pool": 7}),
        (r"'cross_spectra' with .*'half'", {"theta_range": "half", "aggregation": "cross_spectra"}),
        (r"aggregation\.gaps: \(7,\)", {"aggregation": "cross_spectra", "gaps": [7]}),
        (r"aggregation\.gaps: .*, expected null", {"gaps": [11.25]}),
        (r"representation\.pool: 0", {"pool": 0}),
        (r"representation\.angles: 63", {"angles": 63}),
        (r"encoder\.norm: 'layer'", {"norm": "layer"}),
        (r"encoder\.tau_padding: 'same'", {"tau_padding": "same"}),
        (r"encoder\.widths: \[\]", {"widths": ()}),
        (r"encoder\.convolutions: 0", {"convolutions": 0}),
    ],
)
def test_bad_settings_are_named(match, changes):
    with pytest.raises(DeepringError, match=match):
        DeepRing(small(**changes))


@pytest.mark.parametrize(
    "raster", [BevRaster(cells=CELLS), PolarRaster(48, 20), RangeRaster(48, 16)]
)
@pytest.mark.parametrize("aggregation", AGGREGATIONS)
def test_every_aggregation_takes_every_raster(aggregation, raster):
    search = "l2" if aggregation == "dft2" else "correlation"
    angles = {"angles": 48} if isinstance(raster, BevRaster) else {}
    pairs = {"gaps": [15], "frequencies": 4} if aggregation == "cross_spectra" else {}
    choice = {"aggregation": aggregation, "similarity": search, **angles, **pairs}
    net = network(raster=raster_settings(raster), **choice)
    out = net.describe(noise(net))
    rows, columns = (48, 32) if isinstance(net.raster, BevRaster) else net.raster.shape
    values = {"gap": 1, "gmp": 1, "cross_spectra": 13}.get(aggregation, columns // 2 + 1)
    assert out.shape == (3, rows, values) == (3, *net.descriptor_shape)
    assert torch.isfinite(out).all()
