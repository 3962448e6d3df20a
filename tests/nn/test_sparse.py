"""Sparse convolutions: torch's dense ones at the occupied sites, forward and backward."""

import itertools

import pytest
import torch
import torch.nn.functional as F

from deepring.errors import DeepringError
from deepring.nn.sparse import (
    PointNorm,
    SparseTensor,
    StridedConv,
    SubmanifoldConv,
    TransposedConv,
)
from deepring.nn.sparse_grid import Grid

SHAPE = (3, 8, 12, 10)  # batch, θ, r, z


def occupied(seed=0, share=0.25):
    """Sites (n, 4) at random; the corners belong, so that a wrong wrap would meet something."""
    full = torch.rand(SHAPE, generator=torch.Generator().manual_seed(seed)) < share
    for corner in itertools.product(*((0, -1) for _ in SHAPE)):
        full[corner] = True
    return full.nonzero()


def features_on(sites, channels=3, seed=1):
    generator = torch.Generator().manual_seed(seed)
    values = torch.randn(len(sites), channels, dtype=torch.float64, generator=generator)
    return values.requires_grad_()


def dense(features, sites, shape=SHAPE):
    """(b, c, θ, r, z) with zeros at the empty sites."""
    image = features.new_zeros(*shape, features.shape[1])
    return image.index_put(tuple(sites.T), features).movedim(-1, 1)


def at(image, sites):
    """The rows of (b, c, θ, r, z) at the sites."""
    return image.movedim(1, -1)[tuple(sites.T)]


def dense_kernel(weight, size):
    """(k³, in, out) -> (out, in, k, k, k), torch's order."""
    return weight.permute(2, 1, 0).unflatten(2, (size, size, size))


def assert_same(ours, reference, inputs):
    """The same values, and the same gradients of a weighted sum of them."""
    assert torch.allclose(ours, reference, rtol=0, atol=1e-12)
    coefficients = torch.randn(ours.shape, dtype=ours.dtype)
    for a, b in zip(
        torch.autograd.grad((ours * coefficients).sum(), inputs),
        torch.autograd.grad((reference * coefficients).sum(), inputs),
        strict=True,
    ):
        assert a.abs().sum() > 0
        assert torch.allclose(a, b, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kernel", [1, 3, 5])
@pytest.mark.parametrize("share", [0.02, 0.25, 1.0])
def test_stride_one_is_the_dense_convolution_at_the_sites(kernel, share):
    sites = occupied(share=share)
    x = features_on(sites)
    conv = SubmanifoldConv(3, 4, kernel).double()
    ours = conv(SparseTensor.of(x, sites)).features
    image = F.conv3d(dense(x, sites), dense_kernel(conv.weight, kernel), padding=kernel // 2)
    assert_same(ours, at(image, sites), (x, conv.weight))


@pytest.mark.parametrize("kernel", [3, 5])
@pytest.mark.parametrize("used", [(0, 8), (0, 6), (3, 8), (2, 5)])
def test_a_closed_theta_is_circular_padding_wherever_the_sites_lie(kernel, used):
    sites = occupied()
    sites = sites[(sites[:, 1] >= used[0]) & (sites[:, 1] < used[1])]
    x = features_on(sites)
    conv = SubmanifoldConv(3, 4, kernel).double()
    ours = conv(SparseTensor.of(x, sites, wrap=SHAPE[1])).features
    reach = kernel // 2
    padded = F.pad(dense(x, sites), (0, 0, 0, 0, reach, reach), mode="circular")
    padded = F.pad(padded, (reach, reach, reach, reach))
    image = F.conv3d(padded, dense_kernel(conv.weight, kernel))
    assert_same(ours, at(image, sites), (x, conv.weight))
    if used == (0, 8):  # the open circle is another convolution
        assert not torch.allclose(ours, conv(SparseTensor.of(x, sites)).features)


@pytest.mark.parametrize("sectors", [1, 2])
def test_a_circle_shorter_than_the_kernel_wraps_as_often_as_torch_allows(sectors):
    sites = occupied()
    sites = sites[sites[:, 1] < sectors]
    x = features_on(sites)
    conv = SubmanifoldConv(3, 4, 3).double()
    ours = conv(SparseTensor.of(x, sites, wrap=sectors)).features
    image = dense(x, sites, (SHAPE[0], sectors, *SHAPE[2:]))
    padded = F.pad(F.pad(image, (0, 0, 0, 0, 1, 1), mode="circular"), (1, 1, 1, 1))
    image = F.conv3d(padded, dense_kernel(conv.weight, 3))
    assert_same(ours, at(image, sites), (x, conv.weight))


@pytest.mark.parametrize("share", [0.02, 0.25, 1.0])
def test_stride_two_is_the_dense_convolution_wherever_a_child_is_occupied(share):
    sites = occupied(share=share)
    x = features_on(sites)
    conv = StridedConv(3, 4).double()
    ours = conv(SparseTensor.of(x, sites))
    parents = torch.cat([sites[:, :1], sites[:, 1:] // 2], dim=1).unique(dim=0)
    assert torch.equal(ours.coordinates, parents)
    assert ours.stride == 2
    image = F.conv3d(dense(x, sites), dense_kernel(conv.weight, 2), stride=2)
    assert_same(ours.features, at(image, parents), (x, conv.weight))


@pytest.mark.parametrize("share", [0.02, 0.25, 1.0])
def test_the_way_back_is_the_dense_transposed_convolution_at_the_finer_sites(share):
    sites = occupied(share=share)
    fine = SparseTensor.of(features_on(sites), sites)
    coarse, _ = fine.grid.coarser
    x = features_on(coarse.coordinates, seed=2)
    conv = TransposedConv(3, 4).double()
    ours = conv(SparseTensor(x, coarse), fine.grid)
    assert ours.grid is fine.grid
    halves = (SHAPE[0], *(extent // 2 for extent in SHAPE[1:]))
    kernel = dense_kernel(conv.weight, 2).transpose(0, 1)
    image = F.conv_transpose3d(dense(x, coarse.coordinates, halves), kernel, stride=2)
    assert_same(ours.features, at(image, sites), (x, conv.weight))


def test_single_precision_agrees_with_dense_to_1e_5():
    sites = occupied()
    x = features_on(sites, channels=16).detach().float()
    conv = SubmanifoldConv(16, 16, 3)
    ours = conv(SparseTensor.of(x, sites)).features
    image = F.conv3d(dense(x, sites), dense_kernel(conv.weight, 3), padding=1)
    assert torch.allclose(ours, at(image, sites), rtol=0, atol=1e-5)


def test_the_gradients_pass_the_numerical_check():
    sites = occupied(share=0.02)
    conv = SubmanifoldConv(2, 2, 3).double()
    pairs = Grid(sites).neighbours(3)
    x = features_on(sites, channels=2)
    assert torch.autograd.gradcheck(lambda a, _: conv.apply_map(a, pairs), (x, conv.weight))


def test_negative_coordinates_are_halved_downwards():
    sites = torch.tensor([[0, -3, 0, -1], [0, -4, 1, -2], [0, 4, 0, 0]])
    grid, _ = Grid(sites).coarser
    assert grid.coordinates.tolist() == [[0, -2, 0, -1], [0, 2, 0, 0]]


def test_convolutions_do_not_care_where_the_origin_is():
    sites = occupied()
    x = features_on(sites).detach()
    conv = SubmanifoldConv(3, 4, 5).double()
    there = sites + torch.tensor([0, -1000, 20_000, -7])
    assert torch.equal(
        conv(SparseTensor.of(x, there)).features, conv(SparseTensor.of(x, sites)).features
    )


def test_the_order_of_the_rows_does_not_matter():
    sites = occupied()
    x = features_on(sites).detach()
    order = torch.randperm(len(sites))
    for conv in (SubmanifoldConv(3, 4, 5).double(), StridedConv(3, 4).double()):
        sorted_rows = conv(SparseTensor.of(x, sites))
        shuffled = conv(SparseTensor.of(x[order], sites[order]))
        assert torch.equal(shuffled.features, sorted_rows.features)
        assert torch.equal(shuffled.coordinates, sorted_rows.coordinates)


@pytest.mark.parametrize("wrap", [None, SHAPE[1]])
def test_scans_of_a_batch_do_not_see_each_other(wrap):
    sites = occupied()
    x = features_on(sites).detach()
    first, second = SubmanifoldConv(3, 4, 5).double(), StridedConv(4, 2).double()
    together = second(first(SparseTensor.of(x, sites, wrap=wrap))).scans()
    for k in range(SHAPE[0]):
        rows = sites[:, 0] == k
        alone = sites[rows] * torch.tensor([0, 1, 1, 1])
        by_itself = second(first(SparseTensor.of(x[rows], alone, wrap=wrap)))
        assert torch.allclose(by_itself.features, together[k], rtol=0, atol=1e-12)


def test_maps_are_built_once_a_grid():
    grid = Grid(occupied())
    assert grid.neighbours(3) is grid.neighbours(3)
    assert grid.coarser is grid.coarser
    assert grid.neighbours(5) is not grid.neighbours(3)


def test_under_autocast_the_convolution_stays_in_its_own_precision():
    sites = occupied()
    x = features_on(sites).detach().float()
    conv = SubmanifoldConv(3, 4)
    plain = conv(SparseTensor.of(x, sites)).features
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(conv(SparseTensor.of(x, sites)).features, plain)


def test_batch_norm_counts_every_site_once():
    sites = occupied()
    x = SparseTensor.of(features_on(sites).detach() * 3 + 2, sites)
    y = PointNorm(3).double()(x).features
    assert torch.allclose(y.mean(0), torch.zeros(3, dtype=y.dtype), atol=1e-9)
    assert torch.allclose(y.var(0, unbiased=False), torch.ones(3, dtype=y.dtype), atol=1e-4)


def test_batch_norm_of_one_site_needs_evaluation_mode():
    x = SparseTensor.of(torch.ones(1, 3), torch.zeros(1, 4, dtype=torch.int64))
    norm = PointNorm(3)
    with pytest.raises(DeepringError, match="one site at stride 1"):
        norm(x)
    assert norm.eval()(x).features.shape == (1, 3)


SITE = [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("message", "coordinates", "options"),
    [
        ("expected.*integers", torch.zeros(5, 4), {}),
        ("expected.*integers", torch.zeros(5, 3, dtype=torch.int64), {}),
        ("n >= 1", torch.zeros(0, 4, dtype=torch.int64), {}),
        ("1 repeated", torch.tensor([SITE, [0, 0, 0, 0], SITE]), {}),
        (r"\[1, 0, 1\] voxels", torch.tensor([SITE, [2, 1, 2, 3]]), {}),
        (r"\[1, 0\] voxels", torch.tensor([SITE]), {"batch": 2}),
        ("θ from 1 to 1, expected 0 to 0", torch.tensor([SITE]), {"wrap": 1}),
    ],
)
def test_unusable_coordinates_are_refused(message, coordinates, options):
    with pytest.raises(DeepringError, match=rf"coordinates: .*{message}"):
        Grid(coordinates, **options)


def test_misuse_is_named():
    sites = occupied()
    with pytest.raises(DeepringError, match=r"features: \(2, 3\)"):
        SparseTensor.of(torch.zeros(2, 3), sites)
    with pytest.raises(DeepringError, match="kernel: 2"):
        SubmanifoldConv(3, 3, 2)
    with pytest.raises(DeepringError, match=r"wrap: 9 sectors.*even"):
        _ = Grid(sites, wrap=9).coarser
    fine, other = Grid(sites), Grid(sites).coarser[0]
    with pytest.raises(DeepringError, match=r"onto.*stride 2"):
        TransposedConv(3, 3)(SparseTensor(torch.zeros(len(other), 3), other), fine)
