"""Small networks with random weights."""

import torch

from deepring.methods.deepring import DeepRing, DeepRingSettings
from deepring.rasters import BevRaster, raster_settings


def small_network(seed=0, **settings):
    """An untrained DeepRING: what it takes for alike is little better than chance."""
    torch.manual_seed(seed)
    raster = raster_settings(BevRaster())
    return DeepRing(DeepRingSettings(raster, pool=2, widths=(4, 8), convolutions=1, **settings))
