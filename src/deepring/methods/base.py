"""What a place-recognition method is: scans become descriptors, descriptors are compared."""

from typing import NamedTuple, Protocol, runtime_checkable

from torch import Tensor

from deepring.errors import DeepringError
from deepring.rasters import Raster


class Comparison(NamedTuple):
    """Queries against a database."""

    score: Tensor
    """(q, d) float; higher is more alike."""
    turn: Tensor | None
    """(q, d) float32 radians, the turn of the points from entry to query; None if not known."""


@runtime_checkable
class Method(Protocol):
    """A place-recognition method. Every method is evaluated through these calls alone."""

    @property
    def raster(self) -> Raster:
        """The image of a scan that the method describes; it is what the cache holds."""
        ...

    def describe(self, rasters: Tensor) -> Tensor:
        """Descriptors (b, ...) of rasters (b, *raster.shape)."""
        ...

    def compare(self, queries: Tensor, database: Tensor) -> Comparison:
        """Compare descriptors (q, ...) with descriptors (d, ...)."""
        ...


def expect_raster(method: str, raster: Raster, kind: type[Raster]) -> None:
    """Raise DeepringError where a method is given another kind of raster than it describes."""
    if not isinstance(raster, kind):
        raise DeepringError(
            f"{method}: raster {type(raster).__name__}, expected {kind.__name__}; set raster.kind"
        )
