"""Strided sparse convolutions of any kernel: torch's dense ones at every site that they touch."""

import pytest
import torch
import torch.nn.functional as F

from deepring.errors import ConfigError, DataError
from deepring.nn.sparse import KernelConv, SparseTensor, SubmanifoldConv
from deepring.nn.sparse_grid import Grid, scaled

SIZES = [
    (3, 2, 1),
    (3, 2, (1, 1, 0)),
    ((1, 1, 3), (1, 1, 2), 0),
    (2, 2, 0),
    ((3, 2, 1), (2, 1, 3), (1, 0, 0)),
    (3, 1, 1),
]
BATCH, EXTENT = 3, (8, 11, 9)


def occupied(share, extent=EXTENT, seed=0):
    full = torch.rand(BATCH, *extent, generator=torch.Generator().manual_seed(seed)) < share
    full[:, 0, 0, 0] = True
    full[:, -2, -2, -2] = True
    return full.nonzero()


def dense(features, sites, extent=EXTENT):
    image = features.new_zeros(BATCH, *extent, features.shape[1])
    return image.index_put(tuple(sites.T), features).movedim(-1, 1)


def dense_conv(conv, image):
    """torch's convolution by the sparse one's weight (k, in, out)."""
    weight = conv.weight.permute(2, 1, 0).unflatten(2, conv.kernel)
    return F.conv3d(image, weight, stride=conv.stride, padding=conv.padding)


def touched(conv, sites):
    """The sites whose kernel sees one, by a dense convolution of ones."""
    ones = torch.ones(1, 1, *conv.kernel, dtype=torch.float64)
    image = dense(torch.ones(len(sites), 1, dtype=torch.float64), sites)
    counts = F.conv3d(image, ones, stride=conv.stride, padding=conv.padding)
    return (counts[:, 0] > 0.5).nonzero()


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("share", [0.01, 0.2, 1.0])
def test_it_is_the_dense_convolution_with_its_gradients_at_all_touched_sites(sizes, share):
    sites = occupied(share)
    x = torch.randn(len(sites), 3, dtype=torch.float64, requires_grad=True)
    conv = KernelConv(3, 4, *sizes).double()
    ours = conv(SparseTensor.of(x, sites, extent=EXTENT))
    reference = dense_conv(conv, dense(x, sites))
    assert torch.equal(ours.coordinates, touched(conv, sites))
    assert ours.grid.extent == tuple(reference.shape[2:])
    at_sites = reference.movedim(1, -1)[tuple(ours.coordinates.T)]
    assert torch.allclose(ours.features, at_sites, rtol=0, atol=1e-12)
    # Nothing of the dense result is anywhere else.
    assert reference.abs().sum() - at_sites.abs().sum() < 1e-9
    coefficients = torch.randn_like(at_sites)
    inputs = (x, conv.weight)
    for a, b in zip(
        torch.autograd.grad((ours.features * coefficients).sum(), inputs),
        torch.autograd.grad((at_sites * coefficients).sum(), inputs),
        strict=True,
    ):
        assert b.abs().sum() > 0
        assert torch.allclose(a, b, rtol=0, atol=1e-12)


def test_it_dilates_where_the_convolution_of_kernel_two_does_not():
    site = torch.tensor([[0, 3, 4, 5]])
    grid, pairs = Grid(site).strided((3, 3, 3), (2, 2, 2), (1, 1, 1))
    # 3 and 5 are seen from both sides, 4 from its own site alone.
    assert grid.coordinates.tolist() == [[0, x, 2, z] for x in (1, 2) for z in (2, 3)]
    assert sorted(k for k, _, _ in pairs.pairs) == [9 * x + 3 + z for x in (0, 2) for z in (0, 2)]
    assert len(Grid(site).coarser[0]) == 1


def test_an_extent_ends_the_sites_and_without_one_there_is_no_end():
    site = torch.tensor([[0, 7, 0, 0]])
    sizes = ((3, 3, 3), (2, 2, 2), (1, 1, 1))
    assert Grid(site).strided(*sizes)[0].coordinates[:, 1].tolist() == [3, 4]
    ended = Grid(site, extent=(8, 8, 8)).strided(*sizes)[0]
    assert ended.coordinates[:, 1].tolist() == [3]
    assert ended.extent == (4, 4, 4)
    below = Grid(torch.tensor([[0, -1, 0, 0]])).strided(*sizes)[0]
    assert below.coordinates[:, 1].tolist() == [-1, 0]


def test_a_chain_of_them_is_the_dense_chain():
    """As in LCDNet's backbone: strides of 2, then one in z alone; sites within the extent."""
    extent = (16, 16, 13)
    sites = occupied(0.05, extent)
    x = torch.randn(len(sites), 2, dtype=torch.float64)
    first, second = KernelConv(2, 3).double(), KernelConv(3, 4, 3, 2, (1, 1, 0)).double()
    last = KernelConv(4, 5, (1, 1, 3), (1, 1, 2), 0).double()
    ours = last(second(first(SparseTensor.of(x, sites, extent=extent))))
    image = dense_conv(last, dense_conv(second, dense_conv(first, dense(x, sites, extent))))
    assert ours.grid.extent == tuple(image.shape[2:]) == (4, 4, 1)
    assert ours.stride == (4, 4, 8)
    result = ours.features.new_zeros(BATCH, *ours.grid.extent, 5)
    result[tuple(ours.coordinates.T)] = ours.features
    assert torch.allclose(result.movedim(-1, 1), image, rtol=0, atol=1e-12)


def test_submanifold_ones_follow_on_the_sites_of_a_strided_one():
    sites = occupied(0.1)
    x = torch.randn(len(sites), 2, dtype=torch.float64)
    down, same = KernelConv(2, 3).double(), SubmanifoldConv(3, 3).double()
    y = down(SparseTensor.of(x, sites, extent=EXTENT))
    weight = same.weight.permute(2, 1, 0).unflatten(2, (3, 3, 3))
    image = F.conv3d(dense_conv(down, dense(x, sites)), weight, padding=1)
    at_sites = image.movedim(1, -1)[tuple(y.coordinates.T)]
    assert torch.allclose(same(y).features, at_sites, rtol=0, atol=1e-12)


def test_the_order_of_the_rows_does_not_matter_and_maps_are_built_once():
    sites = occupied(0.2)
    x = torch.randn(len(sites), 3, dtype=torch.float64)
    conv, order = KernelConv(3, 4).double(), torch.randperm(len(sites))
    straight = SparseTensor.of(x, sites)
    assert torch.equal(
        conv(SparseTensor.of(x[order], sites[order])).features, conv(straight).features
    )
    sizes = (conv.kernel, conv.stride, conv.padding)
    assert straight.grid.strided(*sizes) is straight.grid.strided(*sizes)


def test_misuse_is_refused():
    site = torch.tensor([[0, 3, 4, 5]])
    three, two, one = (3, 3, 3), (2, 2, 2), (1, 1, 1)
    with pytest.raises(ConfigError, match="wrap: 8 sectors, expected None"):
        Grid(site, wrap=8).strided(three, two, one)
    with pytest.raises(ConfigError, match=r"extent: \[4, 5, 6\].*kernel of \[7, 3, 3\]"):
        Grid(site, extent=(4, 5, 6)).strided((7, 3, 3), two, one)
    with pytest.raises(DataError, match=r"coordinates: from \[3, 4, 5\].*extent=\[4, 5, 5\]"):
        Grid(site, extent=(4, 5, 5))
    with pytest.raises(DataError, match="no site is left"):
        Grid(torch.tensor([[0, 3, 2, 5]])).strided((2, 2, 2), (2, 3, 2), (0, 0, 0))
    with pytest.raises(ConfigError, match="kernel: 0"):
        KernelConv(1, 1, (3, 0, 3))
    with pytest.raises(ConfigError, match="padding: -1"):
        KernelConv(1, 1, 3, 2, -1)
    assert scaled((4, 4, 8), (2, 2, 1)) == 8
