"""From the points of a scan to the array that is cached: one small class a kind of array.

A raster is a frozen dataclass of plain values: it names everything that made an array, so it is
the cache's key and travels in a checkpoint.
"""

from dataclasses import asdict, dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DeepringError
from deepring.rasters.feature_raster import FeatureBevRaster
from deepring.rasters.point_rasters import PointsRaster, VoxelRaster
from deepring.rasters.polar import polar_gram, polar_layers, scan_context
from deepring.rasters.preprocessing import Preprocessing
from deepring.rasters.range_image import range_image
from deepring.rasters.raster_checks import check_crop, check_fields
from deepring.rasters.scan_bev import scan_to_bev


@runtime_checkable
class Raster(Protocol):
    """Points to image: an array of a fixed shape, two axes or more."""

    @property
    def shape(self) -> tuple[int, ...]:
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
        return scan_to_bev(points, ground_z, self.preprocessing, self.extent, self.cells)


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


@dataclass(frozen=True)
class HeightRaster:
    """DiSCO's input: the polar gram in layers of height, lowest first.

    The axes are (height, θ, r), so that a batch is (b, channels, θ, r) and a turn of the scan by
    +2π / sectors rolls axis -2 by +1, as in all other rasters. The published code
    (MaverickPeter/DiSCO-pytorch) has (height, r, θ). ``layers`` of equal height share ``height``,
    metres above the ground; what lies outside is left out.

    The published code crops z to 2 to 20 m above the vehicle's frame and cuts ±20 m into 20 layers
    of 2 m, of which 11 are always empty; ``height=(-20, 20)`` gives its layers. It leaves out the
    10 m square around the sensor and counts what lies beyond ``radius`` in the square's corners
    to the last ring; neither is done here.
    """

    layers: int = 20
    sectors: int = 120
    rings: int = 40
    radius: float = 70.0
    height: tuple[float, float] = (2.0, 20.0)
    preprocessing: Preprocessing = field(
        default_factory=lambda: Preprocessing(height=(2.0, 20.0), clearance=None)
    )

    def __post_init__(self) -> None:
        check_fields(self, ("layers", "sectors", "rings"), ("radius",))
        check_crop(self, self.radius)
        object.__setattr__(self, "height", tuple(self.height))
        low, high = self.height
        if not low < high:
            raise DeepringError(
                f"raster.height: {[low, high]}, expected [low, high] in metres with low < high"
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, θ, r)."""
        return (self.layers, self.sectors, self.rings)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Bits."""
        return np.dtype(np.bool_)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.bool_]:
        """Occupied cells, (layers, sectors, rings) bool."""
        kept = self.preprocessing(points, ground_z)
        return polar_layers(kept, self.radius, self.height, self.shape)


RASTERS: dict[str, type[Raster]] = {
    "bev": BevRaster,
    "polar": PolarRaster,
    "range": RangeRaster,
    "context": ContextRaster,
    "heights": HeightRaster,
    "points": PointsRaster,
    "voxels": VoxelRaster,
    "features": FeatureBevRaster,
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
