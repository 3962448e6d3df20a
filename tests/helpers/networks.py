"""Small networks with random weights, and settings by the names of single values."""

from typing import Any

import torch

from deepring.methods.deepring import (
    AggregationSettings,
    DeepRing,
    DeepRingSettings,
    EncoderSettings,
    RepresentationSettings,
    SimilaritySettings,
)
from deepring.rasters import BevRaster, raster_settings

GROUPS = {
    "representation": (RepresentationSettings, ("angles", "bins", "theta_range", "pool")),
    "encoder": (EncoderSettings, ("widths", "convolutions", "norm", "tau_padding", "stem")),
    "aggregation": (AggregationSettings, ("aggregation", "gaps", "frequencies")),
    "similarity": (SimilaritySettings, ("similarity", "normalisation")),
}


def deepring_settings(raster: dict[str, Any] | None = None, **values: Any) -> DeepRingSettings:
    """DeepRING's, without saying in which group a value stands; ``aggregation`` and
    ``similarity`` are their groups' kinds."""
    groups: dict[str, Any] = {"polar": values.pop("polar", None)}
    for group, (kind, names) in GROUPS.items():
        given = {name: values.pop(name) for name in names if name in values}
        groups[group] = kind(**{"kind" if n == group else n: v for n, v in given.items()})
    assert not values, values
    return DeepRingSettings(**groups) if raster is None else DeepRingSettings(raster, **groups)


def small_network(seed: int = 0, **values: Any) -> DeepRing:
    """An untrained DeepRING: what it takes for alike is little better than chance."""
    torch.manual_seed(seed)
    raster = raster_settings(BevRaster())
    return DeepRing(deepring_settings(raster, pool=2, widths=(4, 8), convolutions=1, **values))
