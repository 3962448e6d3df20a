"""The file of what all places of an index share; see `CorrelationIndex.save`."""

import math
from dataclasses import dataclass

from deepring.checks import between, positive
from deepring.io.sealed import SealedFormat
from deepring.io.tensor_types import TensorType
from deepring.search.code import expect_shape
from deepring.search.search_settings import SearchSettings
from deepring.search.shards import Shard


@dataclass(frozen=True)
class IndexHeader:
    """The values that all places of an index share."""

    settings: SearchSettings
    period: float
    cells: float
    shape: tuple[int, int] | None
    """(θ, ω) of the descriptors; None in an empty index."""
    shards: tuple[Shard, ...]

    def __post_init__(self) -> None:
        between("period", positive("period", self.period), 0, 2 * math.pi + 1e-6, "radians")
        between("cells", self.cells, 1e-6, 1e12)  # scores stay finite when divided
        expect_shape(self.shape)


FORMAT = SealedFormat(
    "index",
    3,
    IndexHeader,
    {
        "basis": TensorType("float32", ("ω", "components"), optional=True),
        "step": TensorType("float32", ("frequencies", "components"), optional=True, least=1e-36),
    },
    description="an index as CorrelationIndex.save writes it",
    remedy="build the index again and save it",
)
