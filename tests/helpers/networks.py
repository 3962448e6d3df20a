"""Settings of small networks, by the names of single values."""

from typing import Any

from deepring.methods.deepring import (
    AggregationSettings,
    DeepRingSettings,
    EncoderSettings,
    RepresentationSettings,
    SimilaritySettings,
)

GROUPS = {
    "representation": (RepresentationSettings, ("angles", "bins", "theta_range", "pool")),
    "encoder": (EncoderSettings, ("widths", "convolutions", "norm", "tau_padding", "stem")),
    "aggregation": (AggregationSettings, ("aggregation",)),
    "similarity": (SimilaritySettings, ("similarity", "normalisation")),
}


def deepring_settings(raster: dict[str, Any] | None = None, **values: Any) -> DeepRingSettings:
    """DeepRING's, without saying in which group a value stands; ``aggregation`` and
    ``similarity`` are their groups' kinds."""
    groups = {}
    for group, (kind, names) in GROUPS.items():
        given = {name: values.pop(name) for name in names if name in values}
        groups[group] = kind(**{"kind" if n == group else n: v for n, v in given.items()})
    assert not values, values
    return DeepRingSettings(**groups) if raster is None else DeepRingSettings(raster, **groups)
