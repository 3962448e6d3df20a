"""DeepRING in real arithmetic, for ONNX: operators that every runtime has.

The Radon transform is one addition of shares to fixed places, and the DFT, whose complex form
ONNX runtimes support little, a product with cosines and sines. A polar branch is one GridSample.
"""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32, Int32
from torch import Tensor, nn

from deepring.core.radon import _directions
from deepring.core.spectrum import _weights
from deepring.errors import ConfigError
from deepring.methods.deepring import DeepRing
from deepring.rasters import BevRaster
from deepring.rasters.bev import disc_mask


class RealDeepRing(nn.Module):
    """`DeepRing.forward` in real arithmetic: images (b, n, n) float32 -> (b, θ, values).

    Raises ConfigError for other settings than a full turn, DFT or cross spectra, and unit norm.
    """

    seen: Tensor
    lower: Tensor
    upper: Tensor
    cosines: Tensor
    sines: Tensor

    def __init__(self, network: DeepRing) -> None:
        super().__init__()
        settings, raster = network.settings, network.raster
        sinogram, kind = settings.representation, settings.aggregation.kind
        made_by = (kind, settings.similarity.normalisation, sinogram.theta_range)
        known = kind in ("dft", "cross_spectra")
        other = not known or made_by[1:] != ("unit", "full")
        if not isinstance(raster, BevRaster) or other or sinogram.angles is None:
            raise ConfigError(
                f"onnx: a network over {type(raster).__name__} with aggregation {made_by[0]}, "
                f"normalisation {made_by[1]}, theta_range {made_by[2]}; expected BevRaster, dft "
                "or cross_spectra, unit, full"
            )
        assert sinogram.bins is not None
        self.encoder, self.pool = network.encoder, sinogram.pool
        self.count, self.bins = sinogram.angles // 2, sinogram.bins
        seen, lower, upper = _projection(raster.cells, self.count, self.bins)
        for name, value in {"seen": seen, "lower": lower, "upper": upper}.items():
            self.register_buffer(name, value)
        self.unit = 2.0 / raster.cells
        columns = self.bins // self.pool // settings.encoder.stem
        aggregation, rows = settings.aggregation, network.descriptor_shape[0]
        self.gaps = tuple(round(gap * rows / 360) for gap in aggregation.gaps or ())
        count = columns // 2 + 1
        count = count if aggregation.frequencies is None else aggregation.frequencies + 1
        angle = 2 * math.pi / columns * torch.arange(columns)[:, None] * torch.arange(count)
        scale = _weights(columns)[:count] / math.sqrt(columns)
        self.register_buffer("cosines", (angle.double().cos() * scale).float())
        self.register_buffer("sines", (-angle.double().sin() * scale).float())
        self.polar = network.polar

    def forward(self, images: Float[Tensor, "batch n n"]) -> Float[Tensor, "batch theta value"]:
        """Descriptors of unit norm."""
        feature = self.encoder(self._sinogram(images))[:, 0]
        real, imaginary = feature @ self.cosines, feature @ self.sines
        parts = [_unit_norm((real.square() + imaginary.square()).sqrt())]
        for gap in self.gaps:
            parts.append(_unit_norm(_cross_spectrum(real[..., 1:], imaginary[..., 1:], gap)))
        descriptor = _unit_norm(torch.cat(parts, dim=-1)) if self.gaps else parts[0]
        if self.polar is None:
            return descriptor
        return self.polar.joined(descriptor, _unit_norm(self.polar(images)))

    def _sinogram(self, images: Float[Tensor, "batch n n"]) -> Float[Tensor, "batch 1 theta tau"]:
        """(b, 1, θ, τ), as `deepring.core.radon.radon`, pooled."""
        batch = images.shape[0]
        values = images.flatten(1)[:, self.seen.long()][:, None] * (self.bins / images.shape[-1])
        index = self.lower.long().flatten().expand(batch, -1)
        above = (values * self.upper).flatten(1)
        below = (values - values * self.upper).flatten(1)
        rows = images.new_zeros(batch, self.count * (self.bins + 2))
        rows = rows.scatter_add(1, index, below).scatter_add(1, index + 1, above)
        half = rows.view(-1, self.count, self.bins + 2)[..., 1:-1]
        whole = torch.cat([half, half.flip(-1)], dim=1) * self.unit
        return F.avg_pool2d(whole[:, None], self.pool) if self.pool > 1 else whole[:, None]


def _cross_spectrum(
    real: Float[Tensor, "batch theta omega"],
    imaginary: Float[Tensor, "batch theta omega"],
    gap: int,
) -> Float[Tensor, "batch theta 2*omega"]:
    """As `deepring.core.spectrum.cross_spectrum`, the real parts before the imaginary ones."""
    other = torch.cat([real[:, gap:], real[:, :gap]], dim=1)
    beside = torch.cat([imaginary[:, gap:], imaginary[:, :gap]], dim=1)
    product = real * other + imaginary * beside
    turned = imaginary * other - real * beside
    root = (product.square() + turned.square()).clamp_min(1e-12).sqrt().sqrt()
    return torch.cat([product / root, turned / root], dim=-1)


def _unit_norm(values: Float[Tensor, "batch theta omega"]) -> Float[Tensor, "batch theta omega"]:
    norm = values.square().sum(dim=(-2, -1), keepdim=True).sqrt()
    return values / norm.clamp_min(1e-12)


def _projection(
    cells: int, count: int, bins: int
) -> tuple[Int32[Tensor, " c"], Int32[Tensor, "{count} c"], Float32[Tensor, "{count} c"]]:
    """The cells of the inscribed disc, flat (c,) int32; for each direction the bin below each of
    them in rows of ``bins`` and one more at either end, flat (θ, c) int32, and the share (θ, c) of
    the bin above."""
    cosines, sines = _directions(count)
    seen = torch.from_numpy(disc_mask(cells).ravel().nonzero()[0])
    along = (torch.arange(cells) - (cells - 1) / 2) * (bins / cells)
    x, y = along[seen // cells], along[seen % cells]
    position = cosines[:, None] * x + sines[:, None] * y + (bins + 1) / 2
    lower = position.floor()
    flat = lower.int() + torch.arange(count, dtype=torch.int32)[:, None] * (bins + 2)
    return seen.int(), flat, position - lower
