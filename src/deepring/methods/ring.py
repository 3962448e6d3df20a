"""RING: the handcrafted ancestor of DeepRING (Lu et al. 2022; lus6-Jenny/RING)."""

import math
from typing import ClassVar

import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from deepring.checks import count, of_type, one_of
from deepring.core.correlation import Form, circular_cross_correlation, shift_to_turn
from deepring.core.radon import radon
from deepring.core.spectrum import row_dft_magnitude, standardise_spectrum
from deepring.methods.method import Comparison, FixedMethod
from deepring.nn.representation import LONGEST
from deepring.rasters import BevRaster, Raster
from deepring.search.compare_index import CompareIndex
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings


class Ring(FixedMethod):
    """Row-wise spectrum of the raw sinogram, normalised, correlated over all rotations.

    ``correlation`` is 'paper', Eq. 8, or 'published', in which the published code takes the
    magnitude of the inverse transform for each frequency before it sums over them. Descriptors
    are the same. Angles leave out the end point. Raw sinogram spectra repeat after half a turn,
    so the turn is known modulo π only.

    Args:
        raster: of the scan from above
        angles: rows of the sinogram, equal parts of a full turn
        bins: columns of the sinogram
    """

    label: ClassVar[str] = "RING"
    raster_class: ClassVar[type[Raster]] = BevRaster
    turn_period: ClassVar[float] = math.pi

    def __init__(
        self,
        raster: Raster | None = None,
        angles: int = 120,
        bins: int = 120,
        correlation: Form = "paper",
    ) -> None:
        self.raster = self.raster_class() if raster is None else raster
        of_type(f"{self.label}: raster", self.raster, self.raster_class)
        one_of(f"{self.label}: correlation", correlation, Form)
        for name, value in (("angles", angles), ("bins", bins)):
            count(f"{self.label}: {name}", value, most=LONGEST)
        self.angles, self.bins, self.correlation = angles, bins, correlation

    @torch.no_grad()
    def describe(
        self, rasters: Shaped[Tensor, " batch *channel n n"]
    ) -> Float[Tensor, "batch theta value"]:
        """TI-RINGs (b, angles, c (bins // 2 + 1)) of images (b, c, n, n), or (b, n, n) with c = 1.

        The c channels lie one after the other along the last axis. Each has zero mean and unit
        deviation of its full spectrum; an empty one is 0.
        """
        channels = rasters if rasters.ndim == 4 else rasters[:, None]
        spectrum = row_dft_magnitude(radon(channels, self.angles, self.bins))
        return standardise_spectrum(spectrum, self.bins).transpose(1, 2).flatten(start_dim=2)

    def compare(
        self, queries: Float[Tensor, "q theta value"], database: Float[Tensor, "d theta value"]
    ) -> Comparison:
        """Correlation per cell, in [-1, 1], as published in [0, 1], and the turn modulo π."""
        match = circular_cross_correlation(queries, database, self.correlation)
        turn = shift_to_turn(match.shift, queries.shape[-2])
        return Comparison(match.score / self._cells, turn)

    @property
    def descriptor_shape(self) -> tuple[int, int]:
        """(θ, values) of one descriptor."""
        return self.angles, self._channels * (self.bins // 2 + 1)

    def index(self, settings: SearchSettings | None = None) -> Index:
        """Search by Eq. 8, or by `compare` where it is the published one; see `index_of`."""
        if self.correlation == "published":
            return CompareIndex(self)
        return CorrelationIndex(settings, cells=self._cells)

    @property
    def _cells(self) -> int:
        """Cells of all channels' full spectra."""
        return self._channels * self.angles * self.bins

    @property
    def _channels(self) -> int:
        return self.raster.shape[0] if len(self.raster.shape) == 3 else 1
