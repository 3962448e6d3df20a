"""Segments: clusters against a loop over all pairs; a segment's shape; the raster's layout."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError, DataError
from deepring.rasters import SegmentsRaster, make_raster, raster_settings
from deepring.rasters.clusters import euclidean_clusters
from deepring.rasters.segment_shape import aligned, hull_distances, hull_points, voxels
from deepring.rasters.segments import unpack_voxels
from deepring.testing import walls
from helpers.real_data import real_data

RASTER = SegmentsRaster(
    max_segments=8, cells=(8, 8, 4), tolerance=0.5, least_points=20, most_points=500
)


def by_pairs(points, tolerance, growth, factor=1.0):
    ranges = np.hypot(points[:, 0], points[:, 1])
    own = factor * np.maximum(tolerance, growth * ranges)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = apart <= np.minimum(own[:, None], own[None])
    return connected_components(near, directed=False)[1]


def refines(fine, coarse):
    """Whether each cluster of the first lies within one of the second."""
    pairs = np.unique(np.column_stack([fine, coarse]), axis=0)
    return len(pairs) == len(np.unique(fine))


def blobs(seed, number=6, points=60, width=0.2, reach=40.0):
    rng = np.random.default_rng(seed)
    centres = np.column_stack([rng.uniform(-reach, reach, (number, 2)), rng.uniform(1, 3, number)])
    cloud = centres[:, None] + rng.normal(0, width, (number, points, 3))
    return cloud.reshape(-1, 3).astype(np.float32)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.sampled_from([0.0, 0.02, 0.2, 1.5]), st.integers(0, 99))
def test_clusters_are_those_of_all_pairs_where_cells_hold_one_point(growth, seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-30, 30, (150, 3))
    points[:, 2] = rng.uniform(0, 1, 150)
    found, expected = euclidean_clusters(points, 2.0, growth), by_pairs(points, 2.0, growth)
    one_a_cell = len(np.unique(np.floor(points / 0.5), axis=0)) == len(points)
    if one_a_cell:
        assert refines(found, expected)
        assert refines(expected, found)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.sampled_from([0.0, 0.03]), st.integers(0, 99))
def test_thinned_clusters_lie_between_those_of_half_and_of_one_and_a_half_tolerances(growth, seed):
    points = blobs(seed, number=8, width=0.3, reach=6.0).astype(np.float64)
    found = euclidean_clusters(points, 0.4, growth)
    assert refines(by_pairs(points, 0.4, growth, 0.5), found)
    assert refines(found, by_pairs(points, 0.4, growth, 1.5))


def test_clusters_are_numbered_by_their_first_points_and_no_points_have_none():
    points = np.array([[9.0, 0, 0], [1, 0, 0], [9.1, 0, 0], [5, 0, 0]])
    assert euclidean_clusters(points).tolist() == [0, 1, 0, 2]
    assert euclidean_clusters(np.zeros((0, 3))).tolist() == []


def test_only_a_tolerance_that_grows_keeps_a_far_wall_of_few_beams_whole():
    # Rows of beams 1.33 degrees apart on a wall at 40 m: 0.93 m from row to row.
    height = np.tan(np.radians(1.33 * np.arange(4))) * 40
    wall = np.array([[40.0, y, z] for z in height for y in np.arange(-2, 2, 0.15)])
    assert euclidean_clusters(wall, 0.2, 0.0).max() == 3
    assert euclidean_clusters(wall, 0.2, 0.0222).max() == 3  # 0.89 m
    assert euclidean_clusters(wall, 0.2, 0.025).max() == 0  # 1 m


def test_a_dense_cloud_does_not_make_a_pair_of_each_two_points():
    points = np.random.default_rng(0).uniform(1, 2, (20_000, 3))
    assert euclidean_clusters(points).max() == 0
    assert euclidean_clusters(np.ones((50_000, 3))).max() == 0


@pytest.mark.parametrize("turn", [0.3, 2.0, -2.5])
def test_a_turn_about_z_changes_neither_an_aligned_segment_nor_its_voxels(turn):
    rng = np.random.default_rng(3)
    part = (rng.exponential(1, (200, 3)) * [4, 1, 2]).astype(np.float64)
    turned = turn_points(part.astype(np.float32), turn)
    first, second = aligned(part), aligned(turned)
    offset = second - first
    assert np.allclose(offset, offset[0], atol=1e-4)  # the turn moves it, no more
    assert np.allclose(np.ptp(first, axis=0), np.ptp(second, axis=0), atol=1e-4)
    assert (voxels(first)[0] != voxels(second)[0]).sum() <= 3


def test_an_aligned_segment_is_longest_along_x_and_most_of_it_below_the_mean_of_y():
    part = np.array([[0, k, 1] for k in range(9)] + [[1.5, 4, 1]] * 3, dtype=float)
    out = aligned(part)
    across = out[:, 1] - out[:, 1].mean()
    assert np.ptp(out[:, 0]) > np.ptp(out[:, 1])
    assert (across < 0).sum() > (across > 0).sum()
    # A mirrored one would need a mirror image: alignment turns only.
    assert np.linalg.det(np.linalg.lstsq(part - part[0], out - out[0], rcond=None)[0][:2, :2]) > 0


def test_voxels_by_hand():
    # 7 m over 8 cells: 1 m each, and the mean in the middle.
    part = np.array([[0.0, 0, 0], [7, 0, 0], [3.5, 0, 0]])
    grid, extents = voxels(part, (8, 8, 4))
    assert np.argwhere(grid).tolist() == [[0, 3, 1], [3, 3, 1], [7, 3, 1]]
    assert extents.tolist() == [7, 0, 0]  # as they are, though no voxel is below 0.1 m
    small, _ = voxels(part / 70, (8, 8, 4))  # 0.1 m fill an eighth of the least 0.8 m
    assert np.ptp(np.argwhere(small), axis=0)[0] <= 1
    # A lopsided one is cut: nine points at one end pull the mean.
    lopsided = np.concatenate([np.zeros((9, 3)), [[7.0, 0, 0]]])
    assert np.argwhere(voxels(lopsided, (8, 8, 4))[0])[:, 0].tolist() == [2]


def test_distances_are_the_least_between_corners_of_hulls():
    rng = np.random.default_rng(0)
    parts = [rng.normal(centre, 0.5, (40, 3)) for centre in ([0, 0, 0], [5, 0, 0], [0, 9, 0])]
    hulls = [hull_points(part) for part in parts]
    assert all(len(hull) < len(part) for hull, part in zip(hulls, parts, strict=True))
    found = hull_distances(hulls)
    for k, a in enumerate(hulls):
        for m, b in enumerate(hulls):
            least = min(np.linalg.norm(p - q) for p in a for q in b) if k != m else 0
            assert found[k, m] == pytest.approx(least, abs=1e-5)
    flat = np.column_stack([rng.uniform(0, 1, (20, 2)), np.zeros(20)])
    assert len(hull_points(flat)) == 20  # a plane has no hull
    assert hull_distances([]).shape == (0, 0)


def test_a_raster_holds_the_segments_with_the_most_points_first():
    # Clusters of 100, 60 and 30 points count, 10 are too few and 600 too many.
    rng = np.random.default_rng(1)
    sizes, places = (
        (30, 100, 10, 600, 60),
        ([9, 0, 2], [0, 12, 2], [-9, 0, 2], [0, -12, 2], [20, 20, 2]),
    )
    parts = [rng.normal(place, 0.1, (n, 3)) for n, place in zip(sizes, places, strict=True)]
    image = RASTER.rasterize(np.concatenate(parts).astype(np.float32))
    segments = RASTER.segments(torch.from_numpy(image)[None])
    assert segments.present[0].tolist() == [True] * 3 + [False] * 5
    for row, part in zip(range(3), (parts[1], parts[4], parts[0]), strict=True):
        grid, extents = voxels(aligned(part.astype(np.float32)), RASTER.cells)
        assert np.allclose(segments.centres[0, row], part.mean(axis=0), atol=1e-4)
        assert np.allclose(segments.extents[0, row], extents, atol=1e-4)
        assert (
            unpack_voxels(segments.bits[0, row : row + 1], RASTER.cells)[0].numpy() == grid
        ).all()
    distances = segments.distances[0]
    assert distances[0, 1] == distances[1, 0] > 10
    assert distances[:3, :3].isfinite().all()
    assert distances[3:].isinf().all()


def test_neither_the_order_of_points_nor_points_that_are_not_finite_change_a_raster():
    points = blobs(2)
    image = RASTER(points, 0.0)
    order = np.random.default_rng(0).permutation(len(points))
    assert (RASTER(points[order], 0.0) == image).all()
    holes = np.concatenate([points, np.float32([[np.nan, 1, 1], [np.inf, 0, 0]])])
    assert (RASTER(holes, 0.0) == image).all()


def test_only_a_scan_without_points_is_blank():
    nothing = RASTER(np.zeros((0, 3), np.float32), 0.0)
    crumbs = RASTER(np.float32([[9, 0, 3], [9, 0, 0], [0, 15, 3], [0, 15, 0]]), 0.0)
    assert RASTER.is_blank(nothing)
    assert not RASTER.is_blank(crumbs)
    for image in (nothing, crumbs):
        assert not RASTER.segments(torch.from_numpy(image)[None]).present.any()


def test_more_segments_than_rows_leave_out_the_smallest():
    few = replace(RASTER, max_segments=2)
    points = blobs(5)
    all_of, some = (r.segments(torch.from_numpy(r(points, 0.0))[None]) for r in (RASTER, few))
    assert torch.equal(some.centres[0], all_of.centres[0, :2])


def test_settings_that_make_no_raster_are_refused():
    for values, name in (
        ({"cells": (32, 32)}, "raster.cells"),
        ({"cells": (32, 30, 16)}, "raster.cells"),
        ({"growth": 10.5}, "raster.growth"),
        ({"tolerance": 0.0}, "raster.tolerance"),
        ({"least_points": 50, "most_points": 40}, "raster.most_points"),
    ):
        with pytest.raises(ConfigError, match=name):
            SegmentsRaster(**values)
    assert make_raster(raster_settings(SegmentsRaster())).shape == (64, 2048 + 24 + 256)


def test_bytes_that_no_scan_makes_are_refused():
    image = torch.from_numpy(RASTER(walls(0), 0.0))[None].clone()
    image[0, 0] = 255
    with pytest.raises(DataError, match="expected what a SegmentsRaster makes"):
        RASTER.segments(image)


def test_a_real_scan_has_the_same_segments_when_it_is_turned():
    records = np.fromfile(real_data("kitti08_pair", "000720.bin"), "<f4").reshape(-1, 4)
    scan, turn = records[:, :3], 1.0
    raster = SegmentsRaster()  # as published for this sensor
    images = [raster(points, -1.73) for points in (scan, turn_points(scan, turn))]
    segments = raster.segments(torch.from_numpy(np.stack(images)))
    first, second = (c[p] for c, p in zip(segments.centres, segments.present, strict=True))
    assert 30 < len(first) < 64
    there = torch.from_numpy(turn_points(first.numpy(), turn))
    again = torch.cdist(there, second).amin(dim=1) < 0.2
    assert again.float().mean() > 0.8
