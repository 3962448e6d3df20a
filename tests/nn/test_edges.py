"""Convolutions over neighbours against loops over points and their neighbours."""

import pytest
import torch

from deepring.errors import DataError
from deepring.nn.edges import NeighbourConv, nearest_rows


def clouds(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def settled(conv, channels):
    """The network with statistics of its own, in evaluation mode."""
    for seed in range(3):
        x = clouds(2, 30, channels, seed=seed + 9)
        conv(x, nearest_rows(x, 4))
    return conv.eval()


@pytest.mark.parametrize("channels", [3, 16])
def test_nearest_rows_are_those_of_a_sort_of_all_distances(channels):
    x = clouds(3, 50, channels) + 100.0  # far from the origin
    expected = torch.cdist(x.double(), x.double()).sort(dim=-1).indices[..., :7]
    found = nearest_rows(x, 7)
    assert torch.equal(found.sort(dim=-1).values, expected.sort(dim=-1).values)
    itself = torch.arange(50)[None, :, None]
    assert (found == itself).any(dim=-1).all()


def test_a_cloud_s_neighbours_do_not_depend_on_the_batch():
    x = clouds(4, 64, 8)
    together = nearest_rows(x, 5)
    assert torch.equal(together, torch.cat([nearest_rows(x[k : k + 1], 5) for k in range(4)]))


def test_too_few_points_are_named():
    with pytest.raises(DataError, match=r"x: 3 points in a cloud, expected at least number=4"):
        nearest_rows(clouds(1, 3, 2), 4)


@torch.no_grad()
@pytest.mark.parametrize("edges", [True, False])
def test_it_is_the_largest_of_each_neighbour_s_network(edges):
    torch.manual_seed(1)
    conv = settled(NeighbourConv(5, (6, 7), edges=edges), 5)
    x = clouds(2, 20, 5)
    near = nearest_rows(x, 4)

    def by_hand(own, other):
        row = torch.cat([own, other - own]) if edges else other
        return conv.rest(conv.first_norm(conv.first(row)[None]))[0]

    found = conv(x, near)
    assert found.shape == (2, 20, 7)
    for b in range(2):
        for i in range(20):
            each = torch.stack([by_hand(x[b, i], x[b, j]) for j in near[b, i]])
            assert torch.allclose(found[b, i], each.amax(dim=0), atol=1e-5)


@torch.no_grad()
def test_edges_know_the_point_itself_and_neighbours_do_not():
    x = clouds(1, 20, 5)
    near = nearest_rows(x, 4)
    near = torch.where(near == 0, near.roll(1, dims=1), near)  # nobody looks at point 0
    moved = x.clone()
    moved[0, 0] += 1.0
    for edges in (True, False):
        torch.manual_seed(1)
        conv = settled(NeighbourConv(5, (6,), edges=edges), 5)
        changed = (conv(moved, near) != conv(x, near)).any(dim=-1)[0]
        assert changed[0] == edges
        assert not changed[1:].any()


def test_gradients_are_those_of_gathering_first():
    torch.manual_seed(2)
    conv = NeighbourConv(4, (5, 5), edges=True).train()
    x = clouds(2, 16, 4).requires_grad_()
    near = nearest_rows(x, 3)
    weight = clouds(2, 16, 5, seed=3)
    (conv(x, near) * weight).sum().backward()
    found, x.grad = x.grad.clone(), None

    rows = torch.stack([cloud[numbers] for cloud, numbers in zip(x, near, strict=True)])
    own = x[:, :, None].expand_as(rows)
    edges = conv.first(torch.cat([own, rows - own], dim=-1)).flatten(0, 2)
    plain = conv.rest(conv.first_norm(edges)).view(2, 16, 3, 5).amax(dim=2)
    (plain * weight).sum().backward()
    assert torch.allclose(found, x.grad, atol=1e-5)
