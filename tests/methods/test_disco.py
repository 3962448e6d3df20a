"""DiSCO: turns that change nothing and those that do, the turn by phase correlation, settings."""

import json
import math

import pytest
import torch

from deepring.core.equivariance import assert_invariant
from deepring.core.phase import central_magnitude
from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.methods.disco import Disco, DiscoSettings
from deepring.methods.method import Method
from deepring.rasters import HeightRaster, PolarRaster, Preprocessing, raster_settings
from helpers.scenes import scattered

RASTER = HeightRaster(
    layers=3,
    sectors=24,
    rings=16,
    height=(0.0, 9.0),
    preprocessing=Preprocessing(height=(0.0, 9.0), clearance=None),
)


def small(**changes):
    values = {"raster": raster_settings(RASTER), "widths": (4, 6, 8), "size": 8}
    return DiscoSettings(**{**values, **changes})


def network(**changes):
    """float64, in evaluation mode, with batch statistics that are not the initial ones."""
    torch.manual_seed(0)
    net = Disco(small(**changes))
    with torch.no_grad():
        for seed in range(3):
            net(images(8, seed + 20))
    return net.eval()


def images(n=4, seed=9):
    generator = torch.Generator().manual_seed(seed)
    return (torch.rand(n, *RASTER.shape, generator=generator) > 0.8).to(torch.uint8)


def maps(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def signature(net):
    return lambda x: net.signature(net(x))


def turn(steps):
    return lambda x: x.roll(steps, dims=-2)


def test_it_is_a_method_of_1024_numbers():
    net = network()
    assert isinstance(net, Method)
    assert net.raster == RASTER
    assert net.describe(images()).shape == (4, 24, 16)
    published = DiscoSettings()
    assert published.raster["layers"] == 20
    assert (published.raster["sectors"], published.raster["rings"]) == (120, 40)
    assert published.raster["radius"] == 70.0
    assert central_magnitude(torch.zeros(2, 120, 40), published.size).shape == (2, 1024)


def test_a_unit_signature_knows_neither_mean_nor_scale_of_the_map():
    feature = maps(3, 24, 16)
    unit = network(signature="unit").signature
    assert torch.allclose(unit(feature).norm(dim=1), torch.ones(3), atol=1e-5)
    assert torch.allclose(unit(7.0 * feature + 5.0), unit(feature), atol=1e-5)
    raw = network().signature
    assert torch.equal(raw(feature), central_magnitude(feature, 8))
    assert not torch.allclose(raw(feature + 5.0), raw(feature), atol=0.1)
    with pytest.raises(DeepringError, match=r"disco\.signature: 'log', expected one of raw, unit"):
        network(signature="log")


@pytest.mark.parametrize("strides", [1, 3, -2])
def test_turns_by_the_stride_change_nothing_with_circular_padding(strides):
    net = network(padding="circular")
    assert net.encoder.stride == 4
    assert_invariant(signature(net), images(), turn(4 * strides), tolerance=1e-5)


@pytest.mark.parametrize(
    ("padding", "act"),
    [
        ("circular", turn(1)),
        ("circular", turn(2)),
        ("circular", lambda x: x.roll(4, dims=-1)),  # away from the sensor
        ("zero", turn(4)),
    ],
    ids=["one row", "half a stride", "radial", "zero padding"],
)
def test_other_shifts_do_change_the_signature(padding, act):
    net = network(padding=padding)
    with torch.no_grad():
        plain, shifted = signature(net)(images()), signature(net)(act(images()))
        other = signature(net)(images(seed=10))
    # The magnitude at frequency zero, the same for all, is left out.
    mean = plain.mean(dim=0)
    apart, foreign = ((a - plain).norm() / (plain - mean).norm() for a in (shifted, other))
    assert 1e-3 < apart < foreign


@pytest.mark.parametrize("steps", [0, 4, 12, 20])
def test_the_yaw_is_the_turn_of_the_points_from_entry_to_query(steps):
    net, angle = network(padding="circular"), steps * 2 * math.pi / 24
    scans = [scattered(seed) for seed in range(3)]

    def describe(points):
        return net.describe(torch.from_numpy(net.raster(points, 0.0))[None])

    database = torch.cat([describe(points) for points in scans])
    query = describe(turn_points(scans[1], angle))
    score, turn = net.compare(query, database)
    assert score.argmax().item() == 1
    wanted = angle if angle < math.pi else angle - 2 * math.pi
    assert turn[0, 1].item() == pytest.approx(wanted, abs=1e-4)
    back = net.compare(database[1:2], query).turn.item()
    assert math.cos(back + wanted) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("aligned", [1, 2, 5, 9, None])
def test_only_the_most_alike_are_aligned(aligned):
    net = network(aligned=aligned)
    queries, database = net.describe(images(3)), net.describe(images(5, seed=10))
    score, turn = net.compare(queries, database)
    known = turn.isfinite()
    assert known.sum(dim=1).tolist() == [min(aligned or 5, 5)] * 3
    assert known.gather(1, score.argmax(dim=1, keepdim=True)).all()
    assert score[known].view(3, -1).amin() >= score.masked_fill(known, -math.inf).amax(1).amin()
    every = network(aligned=None).compare(queries, database).turn
    assert torch.equal(turn[known], every[known])


def test_scores_are_negative_distances_of_signatures():
    net = network()
    queries, database = net.describe(images(3)), net.describe(images(5, seed=10))
    score = net.compare(queries, database).score
    for i in range(3):
        for j in range(5):
            distance = (net.signature(queries[i]) - net.signature(database[j])).norm().item()
            assert score[i, j].item() == pytest.approx(-distance, abs=1e-5)


@pytest.mark.parametrize("padding", ["zero", "circular"])
def test_every_parameter_takes_part(padding):
    net = network(padding=padding).train()
    (signature(net)(images()) * maps(4, 64)).sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())


def test_describing_leaves_training_mode_and_statistics_alone():
    net = network().train()
    before = {name: value.clone() for name, value in net.state_dict().items()}
    assert not net.describe(images()).requires_grad
    assert net.training
    assert all(torch.equal(before[name], value) for name, value in net.state_dict().items())


def test_settings_travel_as_plain_values():
    chosen = small(padding="circular", aligned=None)
    values = json.loads(json.dumps(chosen.to_dict()))
    assert DiscoSettings.from_dict(values) == chosen
    twin = Disco(DiscoSettings.from_dict(values))
    net = network(padding="circular")
    twin.load_state_dict(net.state_dict())
    assert torch.equal(twin.describe(images()), net.describe(images()))


@pytest.mark.parametrize(
    ("message", "changes"),
    [
        (r"disco\.size: 17, expected 1 to 16", {"size": 17}),
        (r"disco\.size: 0", {"size": 0}),
        (r"disco\.aligned: 0", {"aligned": 0}),
        (r"disco\.padding: 'reflect'", {"padding": "reflect"}),
        (r"disco\.widths: \[\]", {"widths": ()}),
        (r"DiSCO: raster: a PolarRaster", {"raster": raster_settings(PolarRaster())}),
    ],
)
def test_bad_settings_are_named(message, changes):
    with pytest.raises(DeepringError, match=message):
        Disco(small(**changes))


def test_bad_names_are_named():
    with pytest.raises(DeepringError, match=r"settings\.rings: unknown"):
        DiscoSettings.from_dict({"rings": 40})
