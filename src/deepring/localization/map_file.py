"""A map as one sealed file; see `deepring.localization.map.Map`."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from deepring import checks
from deepring.errors import DataError
from deepring.io.sealed import SealedFormat
from deepring.io.tensor_types import TensorType, TensorTypes
from deepring.localization.candidates import RerankSettings
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.place_points import COUNTS, XYZ
from deepring.methods.deepring import DeepRing
from deepring.search.code import CodeSettings, expect_shape
from deepring.search.search_settings import SearchSettings
from deepring.search.shards import ROWS

#: How a map's places are stored and searched, unless it is told otherwise. From 2000 places on the
#: best 500 by their codes are compared, an eighth of the work among 10 000. These codes are larger
#: than usual, since the package's network has rows of 151 numbers.
SEARCH = SearchSettings("int8", CodeSettings(16, 24), exhaustive_below=2000)


@dataclass(frozen=True)
class MapHeader:
    """The plain values of a map."""

    network: dict[str, Any]
    """The network, as `deepring.methods.network_file.describe_network` describes it."""
    ground_z: float
    search: SearchSettings
    rerank: RerankSettings
    thresholds: AcceptanceThresholds
    shape: tuple[int, int] | None
    """(θ, ω) of the descriptors; None for a map without places."""
    names: tuple[str, ...]
    source: str
    """What the places were built from, in words."""
    doubts: tuple[str, ...]
    """What was doubtful about that, in words."""

    def __post_init__(self) -> None:
        checks.between("ground_z", self.ground_z, -1e6, 1e6, "metres")
        for name in ("fit", "ratio"):
            checks.at_least(f"thresholds.{name}", getattr(self.thresholds, name), 0)
        expect_shape(self.shape)


#: A map without places has no index.
_INDEX = {f"index.{name}": replace(kind, optional=True) for name, kind in ROWS.items()}

TENSORS: TensorTypes = {
    "images": TensorType("uint8", ("n", "bytes")),
    "poses": TensorType("float64", ("n", 4, 4)),
    **_INDEX,
    "code.basis": TensorType("float32", ("ω", "components"), optional=True),
    "code.step": TensorType("float32", ("frequencies", "components"), optional=True, least=1e-36),
    XYZ: TensorType("int16", ("p", 3), optional=True),
    COUNTS: TensorType("int32", ("n",), optional=True),
    "network.*": None,
}

FORMAT = SealedFormat(
    "map",
    5,
    MapHeader,
    TENSORS,
    description="a map as `deepring map build` writes it",
    remedy="build it again",
)


def expect_fitting(network: DeepRing, header: MapHeader) -> None:
    """Raise DataError unless a map's descriptors and candidates are those of its network."""
    if header.shape not in (None, network.descriptor_shape):
        raise DataError(
            f"shape: {header.shape}, expected {network.descriptor_shape}, the (θ, ω) that the "
            "network's descriptors have"
        )
    raster, alignment = network.raster, header.rerank.alignment
    sizes = (getattr(raster, "cells", None), getattr(raster, "extent", None))
    if header.names and sizes != (alignment.cells, alignment.extent):
        raise DataError(
            f"rerank.alignment: images of {alignment.cells} cells over {alignment.extent:g} m, "
            f"expected those of the network, {sizes[0]} over {sizes[1]:g} m"
        )


def prefixed(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors with a prefix before each name."""
    return {f"{prefix}{name}": tensor for name, tensor in tensors.items()}


def under(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors whose names begin with a prefix, by their names without it."""
    return {
        name.removeprefix(prefix): tensor
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }
