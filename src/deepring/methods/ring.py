"""RING: the handcrafted ancestor of DeepRING (Lu et al. 2022; lus6-Jenny/RING)."""

import torch
from torch import Tensor

from deepring.checks import one_of
from deepring.core.correlation import Form, circular_cross_correlation, shift_to_turn
from deepring.core.radon import radon
from deepring.core.spectrum import row_dft_magnitude, standardise_spectrum
from deepring.methods.base import Comparison, expect_raster
from deepring.rasters import BevRaster


class Ring:
    """Row-wise spectrum of the raw sinogram, normalised, correlated over all rotations.

    ``correlation`` is 'paper', Eq. 8, or 'published', in which the published code takes the
    magnitude of the inverse transform for each frequency before it sums over them. Descriptors
    are the same. Angles leave out the end point. Raw sinogram spectra repeat after half a turn,
    so the turn is known modulo π only.
    """

    def __init__(
        self,
        raster: BevRaster | None = None,
        angles: int = 120,
        bins: int = 120,
        correlation: Form = "paper",
    ) -> None:
        self.raster = BevRaster() if raster is None else raster
        expect_raster("RING", self.raster, BevRaster)
        one_of("ring.correlation", correlation, Form)
        self.angles, self.bins, self.correlation = angles, bins, correlation

    @torch.no_grad()
    def describe(self, rasters: Tensor) -> Tensor:
        """TI-RING (b, angles, bins // 2 + 1), zero mean and unit deviation of the full spectrum."""
        spectrum = row_dft_magnitude(radon(rasters, self.angles, self.bins))
        return standardise_spectrum(spectrum, self.bins)

    def compare(self, queries: Tensor, database: Tensor) -> Comparison:
        """Correlation a cell, in [-1, 1], as published in [0, 1], and the turn modulo π."""
        match = circular_cross_correlation(queries, database, self.correlation)
        size = queries.shape[-2] * self.bins
        return Comparison(match.score / size, shift_to_turn(match.shift, queries.shape[-2]))
