"""A map as one sealed file; see `deepring.localization.map.Map`."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from deepring.io.sealed import SealedFormat
from deepring.io.tensor_types import TensorType, TensorTypes
from deepring.localization.candidates import RerankSettings
from deepring.localization.location import AcceptanceThresholds
from deepring.search.correlation_index import SearchSettings
from deepring.search.shards import ROWS


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


#: A map without places has no index.
_INDEX = {f"index.{name}": replace(kind, optional=True) for name, kind in ROWS.items()}

TENSORS: TensorTypes = {
    "images": TensorType("uint8", ("n", "bytes")),
    "poses": TensorType("float64", ("n", 4, 4)),
    **_INDEX,
    "code.basis": TensorType("float32", ("ω", "components"), optional=True),
    "code.step": TensorType("float32", ("frequencies", "components"), optional=True),
    "network.*": None,
}

FORMAT = SealedFormat(
    "map",
    3,
    MapHeader,
    TENSORS,
    description="a map as `deepring map build` writes it",
    remedy="build it again",
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
