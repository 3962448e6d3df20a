"""What callers give in place of points: taken where it is like an array (n, >=3), or refused."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from deepring.errors import ConfigError, DataError
from deepring.rasters import RASTERS, BevRaster, Preprocessing
from deepring.rasters.bev import bev_occupancy
from deepring.rasters.context import scan_context
from deepring.rasters.heights import polar_layers
from deepring.rasters.local_features import local_features
from deepring.rasters.polar import polar_gram
from deepring.rasters.range_image import range_image
from deepring.rasters.voxels import cylindrical_voxels
from deepring.testing import walls, with_columns

POINTS = walls(0)[:300]

KINDS = [cls for cls in RASTERS.values() if cls.__module__.startswith("deepring.")]

#: Functions of points; those of the second row want finite ones.
FUNCTIONS = (polar_gram, range_image, scan_context, polar_layers, bev_occupancy)
FINITE = (cylindrical_voxels, local_features)

WRONG = (
    *(None, "abc", [], 3.0, object(), [[1, 2], [3]], np.zeros((4, 1)), np.zeros(3)),
    *(np.zeros((2, 3, 3)), POINTS.astype(np.complex64), [[None] * 3], np.array([["a"] * 3])),
)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.kind)
def test_lists_tensors_and_wider_arrays_are_the_same_scan(kind):
    raster = kind()
    rows = with_columns(POINTS, raster.columns)
    expected = raster(rows, 0.0)
    wider = np.column_stack([rows, np.full(len(rows), np.nan)])
    for points in (rows.tolist(), torch.from_numpy(rows), rows.astype(np.float64), wider):
        assert np.array_equal(raster(points, np.float32(0)), expected)
    lost = np.array([[np.nan, 0, 2], [0, np.inf, 2], [5, 5, -np.inf], [3, 1e300, 2], [9, 9, 1e300]])
    lost = with_columns(lost, raster.columns)
    assert np.array_equal(raster(np.concatenate([lost, rows]), 0.0), expected)
    blank = raster(np.zeros((0, rows.shape[1])), 0.0)
    assert blank.shape == raster.shape
    assert raster.is_blank(blank) or raster.kind == "voxels"


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.kind)
def test_other_points_and_grounds_are_refused(kind):
    raster = kind()
    for points in WRONG:
        with pytest.raises(DataError, match=r"^points: .*expected"):
            raster(points, 0.0)
    for ground in (None, "a", np.nan, np.inf, [0.0], True, 1j):
        with pytest.raises(ConfigError, match=r"^ground_z: .*, expected a finite number of metres"):
            raster(with_columns(POINTS, raster.columns), ground)


@pytest.mark.parametrize("function", [*FUNCTIONS, *FINITE], ids=lambda f: f.__name__)
def test_functions_of_points_take_the_same_and_refuse_the_same(function):
    points = POINTS[:50].astype(np.float64)
    assert np.allclose(function(points.tolist()), function(POINTS[:50]), atol=1e-3)
    for wrong in WRONG:
        with pytest.raises(DataError, match=r"^points: .*expected"):
            function(wrong)
    lost = np.concatenate([[[np.nan, 0, 2], [0, np.inf, 2], [5, 5, 1e300]], points])
    if function in FINITE:
        with pytest.raises(DataError, match=r"points: .*not finite|NaN or infinite"):
            function(lost[:1])
    elif function is not bev_occupancy:  # which looks at x and y alone
        assert np.array_equal(function(lost), function(points))


@given(
    arrays.arrays(
        st.sampled_from([np.float16, np.float32, np.float64, ">f8", np.int8, np.uint16]),
        st.tuples(st.integers(0, 6), st.integers(0, 5)),
        elements={"min_value": 0},
    )
)
@settings(max_examples=150, derandomize=True, deadline=None)
def test_any_array_gives_an_image_or_one_error(points):
    raster = BevRaster(cells=8, preprocessing=Preprocessing(clearance=None))
    if points.shape[1] < 3:
        with pytest.raises(DataError):
            raster(points, 0.0)
        return
    image = raster(points, 0.0)
    assert np.array_equal(image, raster(points.tolist(), 0.0) if len(points) else image)
