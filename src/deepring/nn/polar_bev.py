"""A bird's-eye image over azimuth and range, sampled from its cells."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float32, Shaped
from torch import Tensor, nn


class PolarBev(nn.Module):
    """BEV (b, n, n) indexed [x, y] -> (b, 1, θ, r) float32, without parameters.

    Row k covers azimuths 2π [k, k + 1) / ``sectors``, counter-clockwise from x, as in
    `deepring.rasters.polar.polar_gram`: a turn of the image by +2π / sectors shifts the rows by +1,
    in the sense of the sinogram's rows. A quarter turn is exact where it is a whole number of rows,
    as there. Column j covers ranges ``reach`` [j, j + 1) / rings.

    A value is the mean over ``samples`` azimuths times as many ranges, in equal steps around the
    middle of the sector and ring, each interpolated between the centres of the four nearest cells;
    beyond the image it is 0.

    Args:
        sectors: rows, over the full turn.
        rings: columns, of equal width.
        reach: the outer range as a share of half the image's side.
        samples: along each side of a sector and ring.
    """

    grid: Tensor

    def __init__(
        self, sectors: int = 60, rings: int = 60, reach: float = 1.0, samples: int = 2
    ) -> None:
        super().__init__()
        self.sectors, self.rings, self.samples = sectors, rings, samples
        # On the CPU although networks without weights are made on 'meta', where the first number
        # that is made imports a compiler and takes two seconds.
        rows = torch.arange(sectors * samples, dtype=torch.float64, device="cpu")
        columns = torch.arange(rings * samples, dtype=torch.float64, device="cpu")
        azimuth = ((rows + 0.5) * (2 * math.pi) / (sectors * samples))[:, None]
        distance = (columns + 0.5) * (reach / (rings * samples))
        x, y = azimuth.cos() * distance, azimuth.sin() * distance
        # grid_sample wants the last axis first; -1 and 1 are the borders of the image.
        grid = torch.stack([y, x], dim=-1).float()
        self.register_buffer("grid", grid[None], persistent=False)

    def forward(
        self, raster: Shaped[Tensor, "batch x y"]
    ) -> Float32[Tensor, "batch 1 {self.sectors} {self.rings}"]:
        """Polar images of the batch."""
        grid = self.grid.expand(raster.shape[0], -1, -1, -1)
        values = F.grid_sample(
            raster.float()[:, None], grid, "bilinear", "zeros", align_corners=False
        )
        return F.avg_pool2d(values, self.samples) if self.samples > 1 else values
