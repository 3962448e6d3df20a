"""Classes over polar cells and points with classes, against plain loops."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError, DataError
from deepring.rasters import Preprocessing, Raster, SemanticPointsRaster, SemanticRaster
from deepring.rasters.classes import CLASSES, LANDMARKS, PRIORITY, classes_of
from deepring.rasters.semantic_points import FULL

LABELS = np.array([0, 10, 40, 44, 48, 49, 50, 51, 52, 70, 71, 72, 80, 81, 99, 252])


def labelled(seed, count=3000, labels=LABELS):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 20, (count, 3))
    return np.column_stack([points, rng.choice(labels, count)]).astype(np.float32)


def cell_of(x, y, radius, sectors, rings):
    azimuth = math.atan2(y, x) % (2 * math.pi)
    return int(azimuth / (2 * math.pi) * sectors) % sectors, int(math.hypot(x, y) / radius * rings)


def image_by_loop(points, radius, sectors, rings):
    image = np.zeros((sectors, rings), dtype=np.uint8)
    for (x, y, _, _), number in zip(
        points.astype(float), classes_of(points[:, 3]).tolist(), strict=True
    ):
        sector, ring = cell_of(x, y, radius, sectors, rings)
        if ring < rings and PRIORITY[number] > PRIORITY[image[sector, ring]]:
            image[sector, ring] = number
    return image


def test_the_class_of_the_highest_priority_counts():
    def seen(*classes):
        labels = {1: 10, 9: 40, 13: 50, 15: 70, 16: 71, 17: 72}
        points = np.array([[9.5, 0.1, 0, labels[k]] for k in classes])
        return SemanticRaster()(points, 0.0)[0, 9]

    assert seen(9, 13, 16) == 16
    assert seen(1, 9) == 9
    assert seen(15, 17) == 15  # the larger number is not the higher priority
    assert seen(1) == 0  # things that move do not count
    assert sorted(PRIORITY[PRIORITY > 0]) == [*range(9, 20)]
    assert [CLASSES[k] for k in np.flatnonzero(LANDMARKS)] == [
        *("building", "fence", "trunk", "pole", "traffic sign")
    ]


@pytest.mark.parametrize("seed", range(3))
def test_the_image_is_that_of_a_loop_over_the_points(seed):
    points = labelled(seed)
    raster = SemanticRaster(sectors=72, rings=10)
    np.testing.assert_array_equal(raster(points, -1.7), image_by_loop(points, 50.0, 72, 10))


def test_a_turn_rolls_the_sectors():
    points = labelled(4)
    turned = points.copy()
    turned[:, :3] = turn_points(points[:, :3], math.radians(35))
    raster = SemanticRaster()
    same = np.roll(raster(points, 0.0), 35, axis=0) == raster(turned, 0.0)
    assert same.mean() > 0.999  # points on a border may fall to either side
    assert (np.roll(raster(points, 0.0), -35, axis=0) == raster(turned, 0.0)).mean() < 0.95


@pytest.mark.parametrize("sectors", [1, 25, -7])
@pytest.mark.parametrize("point", ["nearest", "last"])
def test_turning_points_with_classes_is_turning_their_scan(sectors, point):
    raster = SemanticPointsRaster(sectors=36, rings=10, count=1500, sector_point=point)
    rng = np.random.default_rng(6)
    azimuth = (rng.integers(72, size=800) + 0.5) * math.pi / 36  # within parts of cells
    r = (rng.integers(20, size=800) + rng.uniform(0.2, 0.8, 800)) * 2.5
    flat = [r * np.cos(azimuth), r * np.sin(azimuth), rng.normal(0, 1, 800)]
    points = np.column_stack([*flat, rng.choice(LABELS, 800)]).astype(np.float32)
    other = points.copy()
    other[:, :3] = turn_points(points[:, :3], sectors * math.tau / 36)
    before, after = (torch.from_numpy(raster(each, 0.0))[None] for each in (points, other))
    found = raster.turned(before, torch.tensor([sectors]))
    assert found.dtype == before.dtype

    def near(one, two):
        return (one.int() - two.int()).abs().max() <= 2  # units of 1.5 mm

    assert near(found[:, :36], after[:, :36])  # a landmark of each sector, in its order
    assert not near(before[:, :36], after[:, :36])
    rest = [np.array(sorted(x[0, 36:].tolist(), key=_by_class)) for x in (found, after)]
    assert np.abs(rest[0] - rest[1]).max() <= 2
    wrong = Raster.turned  # rolls whole points as if azimuth were on their axis
    with pytest.raises(RuntimeError):
        wrong(raster, before, torch.tensor([sectors]))


def _by_class(row):
    """An order of points that rounding does not change: their classes, then their distances."""
    x, y, number = row
    return number, round(math.hypot(x, y) / 40), round(math.atan2(y, x) % math.tau * 36)


def test_the_band_and_the_ground_take_their_labels_along():
    points = labelled(5)
    for preprocessing in (
        Preprocessing(height=(0, 9), clearance=None),
        Preprocessing(height=(-9, 20), clearance=0.5, window=3),
    ):
        rows = preprocessing.rows(points, -1.7)
        kept = points[rows, :3] - np.float32([0, 0, -1.7])
        np.testing.assert_array_equal(kept, preprocessing(points, -1.7))
        assert 100 < len(rows) < len(points)
        raster = SemanticRaster(preprocessing=preprocessing)
        np.testing.assert_array_equal(
            raster(points, -1.7), image_by_loop(points[rows], 50.0, 360, 50)
        )


def test_landmarks_are_the_nearest_or_the_last_of_each_sector():
    points = labelled(6)
    for choice in ("nearest", "last"):
        raster = SemanticPointsRaster(sectors=90, rings=10, count=50, sector_point=choice)
        rows = raster(points, 0.0)[:90].astype(float)
        expected = np.zeros((90, 3))
        least = np.full(90, np.inf)
        for (x, y, _, _), number in zip(
            points.astype(float), classes_of(points[:, 3]).tolist(), strict=True
        ):
            sector, _ = cell_of(x, y, 50.0, 90, 1)
            distance = math.hypot(x, y)
            if not LANDMARKS[number] or distance >= 50:
                continue
            if choice == "last" or distance < least[sector]:
                expected[sector], least[sector] = (x, y, number), distance
        rows[:, :2] *= 50 / FULL
        np.testing.assert_allclose(rows, expected, atol=1e-3)
        assert (expected[:, 2] > 0).all()


@pytest.mark.parametrize("count", [40, 400, 4000])
def test_the_points_that_are_kept_are_of_the_scan_and_one_for_each_quarter_of_a_cell(count):
    points = labelled(7)
    raster = SemanticPointsRaster(sectors=60, rings=10, count=count)
    rows = raster(points, 0.0)[60:].astype(float)
    kept = rows[rows[:, 2] > 0]
    kept[:, :2] *= 50 / FULL
    classes = classes_of(points[:, 3])
    of_scan = np.column_stack([points[:, :2], classes])
    assert all(np.abs(of_scan - row).max(axis=1).min() < 1e-3 for row in kept)
    cells = [cell_of(x, y, 50.0, 120, 20) for x, y, _ in kept]
    assert len(set(cells)) == len(cells)
    whole = image_by_loop(points, 50.0, 120, 20)
    assert all(whole[cell] == number for cell, (_, _, number) in zip(cells, kept, strict=True))
    assert len(kept) == min(count, np.count_nonzero(whole))
    # The best of each whole cell comes first, so that fewer points lose no cell.
    coarse = image_by_loop(points, 50.0, 60, 10)
    first = kept[: np.count_nonzero(coarse)]
    found = {(cell_of(x, y, 50.0, 60, 10), number) for x, y, number in first}
    assert all(coarse[cell] == number for cell, number in found)
    assert len(found) == len(first)


def test_points_without_labels_or_with_other_numbers_are_refused():
    raster = SemanticRaster()
    with pytest.raises(DataError, match=r"points: shape \(9, 3\), expected \(n, 4\): x, y, z, lab"):
        raster(np.zeros((9, 3)), 0.0)
    for label in (-1, 0.5, 65536, np.nan):
        with pytest.raises(DataError, match=r"points: a label .*, expected whole numbers from 0"):
            raster(np.array([[3, 3, 0, label]]), 0.0)
    for name, value in (("sector_point", "first"), ("count", 0), ("radius", -1.0)):
        with pytest.raises(ConfigError, match=rf"raster\.{name}"):
            SemanticPointsRaster(**{name: value})
    with pytest.raises(ConfigError, match="extent"):
        SemanticRaster(radius=80.0)
    assert "its labels are [10, 252], expected SemanticKITTI" in raster.why_blank(
        np.array([[1, 1, 1, 252], [2, 2, 2, 10]]), 0.0
    )
