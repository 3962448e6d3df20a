"""DiSCO's input: the polar gram in layers of height (Xu et al., RA-L 2021, Sec. III-A)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.rasters.base import Raster
from deepring.rasters.preprocessing import Preprocessing, finite_coordinates


@dataclass(frozen=True)
class HeightRaster(Raster, kind="heights"):
    """The polar gram in layers of height, lowest first: (layers, sectors, rings) bool.

    Height comes first, so that a batch is (b, channels, θ, r) and a turn of the scan by
    +2π / sectors rolls axis -2 by +1, as in all other rasters. The published code
    (MaverickPeter/DiSCO-pytorch) has (height, r, θ). ``layers`` of equal height divide ``height``,
    metres above the ground; points outside are ignored.

    The published code crops z to 2 to 20 m above the vehicle's frame and cuts ±20 m into 20 layers
    of 2 m, of which 11 are always empty; ``height=(-20, 20)`` gives its layers. It also drops the
    10 m square around the sensor and adds points beyond ``radius`` in the square's corners to the
    last ring; this class does neither.

    >>> HeightRaster(layers=4).shape
    (4, 120, 40)
    """

    layers: int = 20
    sectors: int = 120  # equal parts of θ
    rings: int = 40  # equal parts of the radius
    radius: float = 70.0  # metres
    height: tuple[float, float] = (2.0, 20.0)
    preprocessing: Preprocessing = field(
        default_factory=lambda: Preprocessing(height=(2.0, 20.0), clearance=None)
    )

    axes = ("height", "theta", "r")
    dtype = np.dtype(np.bool_)

    def __post_init__(self) -> None:
        self.check_disc("layers", "sectors", "rings")
        object.__setattr__(self, "height", checks.interval("raster.height", self.height, "metres"))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Layers, sectors and rings."""
        return (self.layers, self.sectors, self.rings)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Occupied cells (layers, sectors, rings) bool."""
        return polar_layers(points, self.radius, self.height, self.shape)


def polar_layers(
    points: NDArray[np.float32],
    radius: float = 70.0,
    height: tuple[float, float] = (2.0, 20.0),
    shape: tuple[int, int, int] = (20, 120, 40),
) -> NDArray[np.bool_]:
    """Occupancy over polar cells in layers of height, (layers, sectors, rings) bool.

    Sectors as in `deepring.rasters.polar.polar_gram`, on axis -2.

    Args:
        points: (n, 3) float32, metres, z above the ground.
        radius: outer radius, metres.
        height: [low, high) that the layers divide equally, metres, lowest first.
        shape: numbers of layers, sectors and rings.

    >>> points = np.array([[0.0, 30.0, 9.0]], dtype=np.float32)
    >>> np.argwhere(polar_layers(points, 40.0, (0.0, 10.0), (5, 8, 4)))
    array([[4, 2, 3]])
    """
    from deepring.rasters import _polar_kernels

    image = np.zeros(shape, dtype=np.bool_)
    low, high = height
    _polar_kernels.polar_layers(finite_coordinates(points), radius, low, high, image)
    return image
