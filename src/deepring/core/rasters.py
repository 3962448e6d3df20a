"""From the points of a scan to the image that is cached: one small class a kind of image.

A raster is a frozen dataclass of plain values: it names everything that made an image, so it
is the cache's key and travels in a checkpoint.
"""

import math
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from deepring.core.bev import bev_occupancy
from deepring.core.ground import Preprocessing
from deepring.core.polar import polar_gram, scan_context
from deepring.core.range_image import range_image
from deepring.errors import DeepringError


def check_fields(raster: Any, counts: tuple[str, ...], lengths: tuple[str, ...]) -> None:
    """Raise DeepringError where a count is no positive whole number or a length not positive."""
    for name in counts + lengths:
        value = getattr(raster, name)
        whole = isinstance(value, int) and not isinstance(value, bool)
        number = whole or (name in lengths and isinstance(value, float))
        if not number or not 0 < value < math.inf:
            kind = "a whole number" if name in counts else "a length in metres"
            raise DeepringError(f"raster.{name}: {value!r}, expected {kind} above 0")


def check_crop(raster: Any, reach: float) -> None:
    """Raise DeepringError where the preprocessing cuts off what the raster would show."""
    extent = raster.preprocessing.extent
    if extent < reach:
        raise DeepringError(
            f"preprocessing.extent: {extent:g} m, but the {type(raster).__name__} reaches to "
            f"{reach:g} m; expected at least that"
        )


@runtime_checkable
class Raster(Protocol):
    """Points to image."""

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of one image."""
        ...

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of one image; bool images are stored as bits."""
        ...

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[Any]:
        """Image of the points (n, 3) of one scan; ``ground_z`` is the ground in its frame."""
        ...


@dataclass(frozen=True)
class BevRaster:
    """Occupancy from above, masked to the inscribed disc."""

    cells: int = 120
    extent: float = 70.0
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    def __post_init__(self) -> None:
        check_fields(self, ("cells",), ("extent",))
        check_crop(self, self.extent)

    @property
    def shape(self) -> tuple[int, int]:
        """(x, y)."""
        return (self.cells, self.cells)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Bits."""
        return np.dtype(np.bool_)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.bool_]:
        """Occupied cells, (cells, cells) bool."""
        return bev_occupancy(self.preprocessing(points, ground_z), self.extent, self.cells)


@dataclass(frozen=True)
class PolarRaster:
    """The polar gram."""

    sectors: int = 120
    rings: int = 120
    radius: float = 70.0
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    def __post_init__(self) -> None:
        check_fields(self, ("sectors", "rings"), ("radius",))
        check_crop(self, self.radius)

    @property
    def shape(self) -> tuple[int, int]:
        """(θ, r)."""
        return (self.sectors, self.rings)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Bits."""
        return np.dtype(np.bool_)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.bool_]:
        """Occupied polar cells, (sectors, rings) bool."""
        kept = self.preprocessing(points, ground_z)
        return polar_gram(kept, self.radius, self.sectors, self.rings)


@dataclass(frozen=True)
class RangeRaster:
    """The range image."""

    sectors: int = 120
    rows: int = 32
    elevation: tuple[float, float] = (-25.0, 30.0)
    viewpoint: float = 1.8
    max_range: float = 80.0
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    def __post_init__(self) -> None:
        check_fields(self, ("sectors", "rows"), ("max_range",))
        object.__setattr__(self, "elevation", tuple(self.elevation))
        low, high = self.elevation
        if not -90 <= low < high <= 90:
            raise DeepringError(
                f"raster.elevation: {[low, high]}, expected [low, high] degrees in [-90, 90]"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """(θ, elevation)."""
        return (self.sectors, self.rows)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Half precision: 4 cm at 80 m."""
        return np.dtype(np.float16)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.float16]:
        """Closeness of the nearest return, (sectors, rows) float16."""
        kept = self.preprocessing(points, ground_z)
        image = range_image(
            kept, self.sectors, self.rows, self.elevation, self.viewpoint, self.max_range
        )
        return image.astype(np.float16)


@dataclass(frozen=True)
class ContextRaster:
    """Scan Context's largest heights."""

    sectors: int = 60
    rings: int = 20
    radius: float = 80.0
    preprocessing: Preprocessing = field(
        default_factory=lambda: Preprocessing(height=(-2.0, 100.0), clearance=None, extent=80.0)
    )

    def __post_init__(self) -> None:
        check_fields(self, ("sectors", "rings"), ("radius",))
        check_crop(self, self.radius)

    @property
    def shape(self) -> tuple[int, int]:
        """(θ, r)."""
        return (self.sectors, self.rings)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Half precision: 8 mm at 10 m."""
        return np.dtype(np.float16)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.float16]:
        """Largest heights, (sectors, rings) float16."""
        kept = self.preprocessing(points, ground_z)
        return scan_context(kept, self.radius, self.sectors, self.rings).astype(np.float16)


RASTERS: dict[str, type[Raster]] = {
    "bev": BevRaster,
    "polar": PolarRaster,
    "range": RangeRaster,
    "context": ContextRaster,
}


def raster_settings(raster: Raster) -> dict[str, Any]:
    """Plain values that make the raster again: ``{"kind": ..., **fields}``."""
    kind = next(name for name, cls in RASTERS.items() if type(raster) is cls)
    settings = asdict(raster)  # type: ignore[call-overload]
    return {"kind": kind, **settings}


def make_raster(settings: dict[str, Any]) -> Raster:
    """The raster that `raster_settings` described. Raises DeepringError on unknown values."""
    values = dict(settings)
    kind = values.pop("kind", None)
    if kind not in RASTERS:
        raise DeepringError(f"raster.kind: {kind!r}, expected one of {', '.join(RASTERS)}")
    try:
        preprocessing = values.pop("preprocessing", None)
        if preprocessing is not None:
            values["preprocessing"] = Preprocessing(**preprocessing)
        return RASTERS[kind](**values)
    except TypeError as error:
        raise DeepringError(f"raster {kind!r}: {error}") from None
