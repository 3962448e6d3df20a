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
        ({"kind": "bev", "rings": 3}, "raster 'bev': rings, expected only cells, extent, prep"),
        ({"kind": "bev", "preprocessing": {"heigth": 1}}, "preprocessing: heigth, expected only"),
        ({"kind": "bev", "cells": 2.5}, r"raster\.cells: 2\.5, expected a whole number"),
        ({"kind": "bev", "extent": 80.0}, "BevRaster reaches to 80 m"),
    ],
)
def test_settings_that_no_raster_has_are_named(settings, complaint):
    with pytest.raises(ConfigError, match=complaint):
        make_raster(settings)


@pytest.mark.parametrize("cls", RASTERS.values())
def test_axes_are_as_many_as_the_shape_has(cls):
    assert len(cls.axes) == len(cls().shape)
