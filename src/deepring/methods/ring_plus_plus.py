"""RING++: RING of local features instead of occupancy (Xu et al. 2023; lus6-Jenny/RING)."""

import torch
from torch import Tensor

from deepring.checks import one_of
from deepring.core.correlation import Form, circular_cross_correlation, shift_to_turn
from deepring.core.radon import radon
from deepring.core.spectrum import row_dft_magnitude, standardise_spectrum
from deepring.methods.base import Comparison, expect_raster
from deepring.rasters import FeatureBevRaster


class RingPlusPlus:
    """RING's spectrum of each of six channels, correlated over all rotations at once.

    Channels are normalised each by itself, as `circorr2` of the published code does, and share
    the shift: their correlations are summed. ``correlation`` is that of
    `deepring.methods.ring.Ring`; the published code's magnitudes are summed over frequencies and
    channels alike. As with RING, the turn is known modulo π only.
    """

    def __init__(
        self,
        raster: FeatureBevRaster | None = None,
        angles: int = 120,
        bins: int = 120,
        correlation: Form = "paper",
    ) -> None:
        self.raster = FeatureBevRaster() if raster is None else raster
        expect_raster("RING++", self.raster, FeatureBevRaster)
        one_of("ring_plus_plus.correlation", correlation, Form)
        self.angles, self.bins, self.correlation = angles, bins, correlation

    @torch.no_grad()
    def describe(self, rasters: Tensor) -> Tensor:
        """TI-RINGs (b, angles, 6 (bins // 2 + 1)), channel by channel along the last axis.

        Each channel has zero mean and unit deviation of its full spectrum; an empty one is 0.
        """
        spectrum = row_dft_magnitude(radon(rasters, self.angles, self.bins))
        standard = standardise_spectrum(spectrum, self.bins)
        return standard.transpose(1, 2).flatten(start_dim=2)

    def compare(self, queries: Tensor, database: Tensor) -> Comparison:
        """Correlation a cell, in [-1, 1], as published in [0, 1], and the turn modulo π."""
        match = circular_cross_correlation(queries, database, self.correlation)
        size = self.raster.shape[0] * queries.shape[-2] * self.bins
        return Comparison(match.score / size, shift_to_turn(match.shift, queries.shape[-2]))
