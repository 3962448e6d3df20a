"""NetVLAD against a loop over points and centres; its norms, its gate, the order of the points."""

import math

import pytest
import torch

from deepring.errors import DeepringError
from deepring.nn.netvlad import ContextGating, NetVlad


def features(n=15, dimension=6, seed=0, clouds=3):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(clouds, n, dimension, generator=generator, dtype=torch.float64)


def make(clusters=4, dimension=5, **changes):
    """float64, in evaluation mode, with batch statistics that are not the initial ones."""
    torch.manual_seed(0)
    net = NetVlad(6, clusters, dimension, **changes).double()
    with torch.no_grad():
        for seed in range(3):
            net(features(seed=seed + 5, clouds=8) + 0.2)
    return net.eval()


def residuals_by_loop(net, x):
    """Σ_i a_k(x_i) (x_i - c_k), each at norm 1, then all together."""
    norm = net.assignment_norm
    out = torch.zeros_like(net.centres)
    for point in x:
        shares = []
        for k in range(len(net.centres)):
            logit = sum(point[j] * net.assignment[j, k] for j in range(len(point)))
            logit = (logit - norm.running_mean[k]) / math.sqrt(norm.running_var[k] + norm.eps)
            shares.append(math.exp(logit * norm.weight[k] + norm.bias[k]))
        for k, share in enumerate(shares):
            out[k] += share / sum(shares) * (point - net.centres[k])
    out = torch.stack([row / row.norm() for row in out])
    return out / out.norm()


@torch.no_grad()
def test_residuals_against_a_loop():
    net, x = make(), features()
    actual = net.residuals(x)
    assert actual.shape == (3, 4, 6)
    for k in range(len(x)):
        assert torch.allclose(actual[k], residuals_by_loop(net, x[k]), atol=1e-12)


@torch.no_grad()
def test_the_rest_against_plain_products():
    net, x = make(), features()
    vector = torch.stack([v.flatten() @ net.projection for v in net.residuals(x)])
    vector = net.projection_norm(vector)
    gates = torch.sigmoid(net.gate.norm(vector @ net.gate.weight))
    assert torch.allclose(net(x), vector * gates, atol=1e-12)
    assert torch.allclose(make(gating=False)(x), vector, atol=1e-12)


@torch.no_grad()
def test_every_centre_has_the_same_weight_and_the_whole_unit_norm():
    parts = make(clusters=4).residuals(features())
    assert torch.allclose(parts.norm(dim=2), torch.full((3, 4), 0.5, dtype=torch.float64))
    assert torch.allclose(parts.flatten(1).norm(dim=1), torch.ones(3, dtype=torch.float64))


@torch.no_grad()
def test_vanishing_residuals_stay_finite():
    net = make(clusters=1)
    x = net.centres.expand(2, 15, 6)  # every point lies on the only centre
    assert torch.equal(net.residuals(x), torch.zeros(2, 1, 6, dtype=torch.float64))
    assert torch.isfinite(net(x)).all()


@torch.no_grad()
def test_neither_order_nor_number_of_points_matters():
    net, x = make(), features()
    order = torch.randperm(15, generator=torch.Generator().manual_seed(1))
    assert torch.allclose(net(x[:, order]), net(x), atol=1e-12)
    assert torch.allclose(net(torch.cat([x, x], dim=1)), net(x), atol=1e-12)
    assert not torch.allclose(net(x[:, :10]), net(x), atol=1e-3)


@torch.no_grad()
def test_gates_only_let_through():
    torch.manual_seed(0)
    gate = ContextGating(5).eval()
    x = torch.randn(4, 5)
    assert (gate(x).abs() < x.abs()).all()
    assert torch.equal(gate(x).sign(), x.sign())


def test_every_parameter_takes_part():
    net = make().train()
    (net(features()) * features(1, 5)[:, 0]).sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())


def test_parameters_of_the_published_size():
    count = sum(p.numel() for p in NetVlad().parameters())
    assert count == 2 * 1024 * 64 + 2 * 64 + 64 * 1024 * 256 + 2 * 256 + 256 * 256 + 2 * 256


@pytest.mark.parametrize("name", ["features", "clusters", "dimension"])
def test_bad_numbers_are_named(name):
    with pytest.raises(DeepringError, match=rf"netvlad\.{name}: 0"):
        NetVlad(**{"features": 2, "clusters": 2, "dimension": 2, name: 0})


@torch.no_grad()
def test_attention_weighs_points_and_none_leaves_zeros():
    net, x = make(), features()
    plain = net.residuals(x)
    assert torch.allclose(net.residuals(x, torch.full(x.shape[:2], 0.3, dtype=x.dtype)), plain)
    first = torch.zeros(x.shape[:2], dtype=x.dtype)
    first[:, :5] = 1.0
    assert torch.allclose(net.residuals(x, first), net.residuals(x[:, :5]), atol=1e-12)
    assert not torch.allclose(net.residuals(x, first), plain, atol=1e-2)
    nothing = net.residuals(x, torch.zeros_like(first))
    assert torch.equal(nothing, torch.zeros_like(nothing))
    assert net(x, torch.zeros_like(first)).isfinite().all()
