"""The paper's rotation-equivariant representations, from a raster to the input (b, 1, θ, τ).

They have no parameters, and run on the device of the batch."""

import torch.nn.functional as F
from jaxtyping import Float32, Shaped
from torch import Tensor, nn

from deepring import checks
from deepring.core.radon import ThetaRange, radon
from deepring.errors import ConfigError
from deepring.rasters import Raster

#: Rows or columns of a sinogram.
LONGEST = 4096


class Sinogram(nn.Module):
    """BEV (b, n, n) -> sinogram (b, 1, angles / pool, bins / pool), scaled to about [0, 1].

    ``pool`` averages neighbouring rows and bins, which saves time at the cost of resolution. Values
    are divided by half the field of view: a value is the share of occupied cells along half a
    line through the centre. Over half a turn the step between angles is half as large.
    """

    def __init__(
        self, angles: int = 120, bins: int = 120, pool: int = 1, theta_range: ThetaRange = "full"
    ) -> None:
        super().__init__()
        checks.one_of("representation.theta_range", theta_range, ThetaRange)
        if checks.count("representation.angles", angles, most=LONGEST) % 2:
            raise ConfigError(f"representation.angles: {angles}, expected an even number")
        checks.count("representation.bins", bins, most=LONGEST)
        if pool < 1 or angles % pool or bins % pool:
            raise ConfigError(
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

    def forward(
        self, raster: Shaped[Tensor, "batch x y"]
    ) -> Float32[Tensor, "batch 1 {self.rows} {self.columns}"]:
        """Sinograms of the batch."""
        sinogram = radon(raster, self.angles, self.bins, theta_range=self.theta_range)[:, None]
        return F.avg_pool2d(sinogram, self.pool) if self.pool > 1 else sinogram


class PolarImage(nn.Module):
    """Polar gram or range image (b, θ, r) -> (b, 1, θ / pool, r / pool)."""

    def __init__(self, sectors: int = 120, cells: int = 120, pool: int = 1) -> None:
        super().__init__()
        if pool < 1 or sectors % pool or cells % pool:
            raise ConfigError(
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
        """Columns of r or of elevation."""
        return self.cells // self.pool

    def forward(
        self, raster: Shaped[Tensor, "batch {self.sectors} {self.cells}"]
    ) -> Float32[Tensor, "batch 1 {self.rows} {self.columns}"]:
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
    """The representation for a raster, by its axes; see `Raster.axes`.

    A bird's-eye image becomes a sinogram of ``angles`` and ``bins``. An image over azimuth keeps
    the rows and columns of the raster, so that ``angles`` and ``bins`` must be None and
    ``theta_range`` 'full'. Raises ConfigError for other values and other rasters.
    """
    kind = type(raster).__name__
    size = f"representation.angles: {angles}, representation.bins: {bins}"
    match raster.axes:
        case ("x", "y"):
            if angles is None or bins is None:
                raise ConfigError(f"{size}; expected both for the sinogram of a {kind}")
            return Sinogram(angles, bins, pool, theta_range)
        case ("theta", _):
            if angles is not None or bins is not None:
                raise ConfigError(
                    f"{size}; expected null, since the rows and columns are those of the {kind}"
                )
            if theta_range != "full":
                raise ConfigError(
                    f"representation.theta_range: {theta_range!r}, expected 'full': only "
                    "sinograms can be limited to half a turn"
                )
            sectors, columns = raster.shape
            return PolarImage(sectors, columns, pool)
    raise ConfigError(
        f"representation: a {kind} has the axes {', '.join(raster.axes)}, expected x, y or theta "
        "and one more"
    )
