"""RING: the handcrafted ancestor of DeepRING (Lu et al. 2022; lus6-Jenny/RING)."""

import torch
from torch import Tensor

from deepring.core.correlation import circular_cross_correlation, shift_to_yaw
from deepring.core.radon import radon
from deepring.core.rasters import BevRaster
from deepring.core.spectrum import row_dft_magnitude, standardise_spectrum
from deepring.methods.base import Comparison, expect_raster


class Ring:
    """Row-wise spectrum of the raw sinogram, normalised, correlated over all rotations.

    The correlation is the paper's Eq. 8; the published code's variant takes the magnitude of
    the inverse transform for each frequency. Angles leave out the end point. Raw sinogram
    spectra repeat after half a turn, so the yaw is known modulo π only.
    """

    def __init__(self, raster: BevRaster | None = None, angles: int = 120, bins: int = 120) -> None:
        self.raster = BevRaster() if raster is None else raster
        expect_raster("RING", self.raster, BevRaster)
        self.angles, self.bins = angles, bins

    @torch.no_grad()
    def describe(self, rasters: Tensor) -> Tensor:
        """TI-RING (b, angles, bins // 2 + 1), zero mean and unit deviation of the full spectrum."""
        spectrum = row_dft_magnitude(radon(rasters, self.angles, self.bins))
        return standardise_spectrum(spectrum, self.bins)

    def compare(self, queries: Tensor, database: Tensor) -> Comparison:
        """Correlation a cell, in [-1, 1], and the yaw modulo π."""
        match = circular_cross_correlation(queries, database)
        size = queries.shape[-2] * self.bins
        return Comparison(match.score / size, shift_to_yaw(match.shift, queries.shape[-2]))
