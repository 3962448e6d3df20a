"""From a cached raster to the network's input (b, 1, θ, τ): the paper's rotation-equivariant
representations. They have no parameters; they run where the batch lies, CPU or GPU."""

import torch.nn.functional as F
from torch import Tensor, nn

from deepring.core.radon import ThetaRange, expect_theta_range, radon
from deepring.errors import DeepringError
from deepring.rasters import BevRaster, PolarRaster, RangeRaster, Raster


class Sinogram(nn.Module):
    """BEV (b, n, n) -> sinogram (b, 1, angles / pool, bins / pool), scaled to about [0, 1].

    ``pool`` averages neighbouring rows and bins, which costs resolution and saves time. Values
    are divided by half the field of view: a row's value is the share of occupied cells along
    half a line through the centre. Over half a turn the angles step half as far.
    """

    def __init__(
        self, angles: int = 120, bins: int = 120, pool: int = 1, theta_range: ThetaRange = "full"
    ) -> None:
        super().__init__()
        expect_theta_range("representation.theta_range", theta_range)
        if angles < 2 or angles % 2:
            raise DeepringError(f"representation.angles: {angles}, expected an even number")
        if pool < 1 or angles % pool or bins % pool:
            raise DeepringError(
                f"representation.pool: {pool}, expected a divisor of "
                f"angles={angles} and bins={bins}"
            )
        self.angles, self.bins, self.pool, self.theta_range = angles, bins, pool, theta_range

    @property
    def rows(self) -> int:
        """Rows of θ."""
        return self.angles // self.pool

    @property
    def columns(self) -> int:
        """Bins of τ."""
        return self.bins // self.pool

    def forward(self, raster: Tensor) -> Tensor:
        """Sinograms of the batch."""
        sinogram = radon(raster, self.angles, self.bins, theta_range=self.theta_range)[:, None]
        return F.avg_pool2d(sinogram, self.pool) if self.pool > 1 else sinogram


class PolarImage(nn.Module):
    """Polar gram or range image (b, θ, r) -> (b, 1, θ / pool, r / pool)."""

    def __init__(self, sectors: int = 120, cells: int = 120, pool: int = 1) -> None:
        super().__init__()
        if pool < 1 or sectors % pool or cells % pool:
            raise DeepringError(
                f"representation.pool: {pool}, expected a divisor of the raster's "
                f"{sectors} x {cells}"
            )
        self.sectors, self.cells, self.pool = sectors, cells, pool

    @property
    def rows(self) -> int:
        """Rows of θ."""
        return self.sectors // self.pool

    @property
    def columns(self) -> int:
        """Columns of r, or of the elevation."""
        return self.cells // self.pool

    def forward(self, raster: Tensor) -> Tensor:
        """Images of the batch as float32."""
        image = raster.float()[:, None]
        return F.avg_pool2d(image, self.pool) if self.pool > 1 else image


def make_representation(
    raster: Raster,
    angles: int | None = 120,
    bins: int | None = 120,
    pool: int = 1,
    theta_range: ThetaRange = "full",
) -> Sinogram | PolarImage:
    """The representation that goes with a raster; angles, bins, turn are the sinogram's alone."""
    match raster:
        case BevRaster():
            if angles is None or bins is None:
                raise DeepringError(
                    f"representation.angles: {angles}, representation.bins: {bins}; "
                    "a sinogram needs both"
                )
            return Sinogram(angles, bins, pool, theta_range)
        case PolarRaster() | RangeRaster():
            if angles is not None or bins is not None:
                raise DeepringError(
                    f"representation.angles: {angles}, representation.bins: {bins}; expected null, "
                    f"since the rows and columns of a {type(raster).__name__} are its raster's"
                )
            if theta_range != "full":
                raise DeepringError(
                    f"representation.theta_range: {theta_range!r}, expected 'full': only a "
                    "sinogram repeats itself after half a turn"
                )
            return PolarImage(*raster.shape, pool)
    raise DeepringError(f"representation: no network takes a {type(raster).__name__}")
