"""The base of all rasters: registered kinds, names of settings, one owner per kind."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from deepring.errors import ConfigError
from deepring.rasters import RASTERS, BevRaster, Preprocessing, Raster, make_raster


def test_a_kind_has_one_owner():
    with pytest.raises(ConfigError, match=r"kind: 'bev' of .*Usurper, expected a new name"):

        class Usurper(Raster, kind="bev"):
            pass

    assert RASTERS["bev"] is BevRaster


def test_a_kind_is_named_with_its_class():
    with pytest.raises(TypeError, match="kind"):

        class Nameless(Raster):
            pass


def test_what_a_raster_must_say_is_abstract():
    try:

        @dataclass(frozen=True)
        class Half(Raster, kind="half"):
            preprocessing: Preprocessing = field(default_factory=Preprocessing)
            axes = ("x",)
            dtype = np.dtype(np.bool_)

        with pytest.raises(TypeError, match=r"abstract.*rasterize"):
            make_raster({"kind": "half"})
    finally:
        RASTERS.pop("half", None)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"kind": "cubes"}, r"raster\.kind: 'cubes', expected one of bev, "),
        ({}, r"raster\.kind: None"),
        (
            {"kind": "bev", "rings": 3},
            r"raster\.rings: unknown, expected one of cells, extent, prep",
        ),
        (
            {"kind": "bev", "preprocessing": {"heigth": 1}},
            r"raster\.preprocessing\.heigth: unknown, expected one of height",
        ),
        ({"kind": "bev", "cells": 2.5}, r"raster\.cells: 2\.5, expected a whole number"),
        ({"kind": "bev", "extent": 80.0}, "BevRaster reaches to 80 m"),
        ({"kind": "bev", "cells": 10**9}, "expected at most 16777216"),
        ({"kind": "points", "count": 10**9}, r"raster\.count: 1000000000, expected at most"),
        ({"kind": "bev", "extent": 1e300}, r"raster\.extent: 1e\+300, expected .* to 10000"),
        ({"kind": "bev", "preprocessing": {"cell": 1e-6}}, r"preprocessing\.cell: 1e-06 m"),
        ({"kind": "bev", "preprocessing": {"window": 10**9 + 1}}, r"preprocessing\.window"),
        ({"kind": "bev", "preprocessing": 3}, r"raster\.preprocessing: 3, expected values"),
        ({"kind": "voxels", "degrees": 1e-6}, r"voxels\.degrees: 1e-06"),
        ([], "raster: a list, expected a dict"),
    ],
)
def test_settings_that_no_raster_has_are_named(settings, complaint):
    with pytest.raises(ConfigError, match=complaint):
        make_raster(settings)


@pytest.mark.parametrize("cls", RASTERS.values())
def test_axes_are_as_many_as_the_shape_has(cls):
    assert len(cls.axes) == len(cls().shape)
