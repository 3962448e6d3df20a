"""OverlapNet (Chen et al., RSS 2020): how much two scans overlap, and the turn between them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from deepring import checks
from deepring.core import fourier
from deepring.core.correlation import correlation_curves, shift_to_turn, theta_spectrum
from deepring.errors import ConfigError
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.methods.overlapnet.legs import PUBLISHED, Legs, checked_layers, sizes
from deepring.methods.overlapnet.overlap_head import OverlapHead
from deepring.rasters import RangeNormalRaster, raster_settings
from deepring.search.compare_index import CompareIndex
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.shortlist import ShortlistIndex, key_distances, shortlisted

#: Differences of columns that are in memory at once: 128 MiB of float32.
_DIFFERENCES = 2**25

#: Values of curves that are in memory at once.
_CURVES = 2**24


@dataclass(frozen=True)
class OverlapNetSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "OverlapNet"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(RangeNormalRaster()))
    #: Of each convolution: rows and columns of the kernel, steps along both, channels.
    layers: Sequence[Sequence[int]] = PUBLISHED
    #: Convolutions go on around the seam of the image; as published they do not.
    circular: bool = False
    #: The second scan's columns are turned to those of the first before the head sees them; as
    #: published they are not.
    aligned: bool = False
    block: int = 15  # columns that the head takes together
    widths: Sequence[int] = (64, 128, 256)  # channels of the head's convolutions
    #: Places whose overlap with a query is computed; None computes all, as published.
    candidates: int | None = None


class OverlapNet(NetworkMethod):
    """Ranges and normals (b, 4, θ, rows) -> columns (b, columns, channels), compared by a network.

    The score is the overlap in [0, 1] that the head tells, and -1 for places that are no
    candidates: those are the nearest by the mean of the columns, at unit norm. The turn is the
    shift at which the columns of both correlate best.
    """

    settings_class = OverlapNetSettings
    settings: OverlapNetSettings

    def __init__(self, settings: OverlapNetSettings | None = None) -> None:
        settings = OverlapNetSettings() if settings is None else settings
        super().__init__(settings, RangeNormalRaster)
        layers = checked_layers(settings.layers)
        circular = checks.of_type("overlapnet.circular", settings.circular, bool)
        checks.of_type("overlapnet.aligned", settings.aligned, bool)
        if settings.candidates is not None:
            checks.count("overlapnet.candidates", settings.candidates)
        channels, sectors, rows = self.raster.shape
        columns, left = sizes(layers, sectors, rows, circular)[-1]
        if left != 1:
            raise ConfigError(
                f"overlapnet.layers: {left} of the {rows} rows of the raster are left, expected 1; "
                "choose other steps, or another raster"
            )
        self.columns = columns
        self.legs = Legs(channels, layers, circular)
        self.head = OverlapHead(columns, layers[-1].channels, settings.block, settings.widths)

    def forward(
        self, rasters: Float[Tensor, "batch channel theta row"]
    ) -> Float[Tensor, "batch column value"]:
        """Columns of features (b, columns, channels) float32, at least 0."""
        columns: Tensor = self.legs(rasters.float())
        return columns

    def overlap_logits(
        self, first: Float[Tensor, "n column value"], second: Float[Tensor, "n column value"]
    ) -> Float[Tensor, " n"]:
        """Logits (n,) of the overlap of each first and second."""
        if self.settings.aligned:
            second = rolled(second, self.turn_curves(first, second).argmax(dim=-1))
        logits: Tensor = self.head(first, second)
        return logits

    def turn_curves(
        self, first: Float[Tensor, "n column value"], second: Float[Tensor, "n column value"]
    ) -> Float[Tensor, "n column"]:
        """Correlation of each first with its second, rolled by 0, 1, ... columns: (n, columns)."""
        cross = theta_spectrum(first) * theta_spectrum(second).conj()
        return fourier.irfft(cross.sum(dim=-1), n=self.columns, dim=-1)

    def compare(
        self, queries: Float[Tensor, "q column value"], database: Float[Tensor, "d column value"]
    ) -> Comparison:
        """The overlap of each query with its candidates, -1 for others, and the turns of all."""
        score = queries.new_full((len(queries), len(database)), -1.0)
        if not score.numel():
            return Comparison(score, torch.zeros_like(score))
        # Only descriptors under training want the gradient, the head's weights alone do not.
        wanted = torch.is_grad_enabled() and (queries.requires_grad or database.requires_grad)
        with torch.set_grad_enabled(wanted):
            distance = key_distances(mean_columns(queries), mean_columns(database))
            chosen = shortlisted(distance, self.settings.candidates).nonzero()
            at_once = max(1, _DIFFERENCES // (queries[0].numel() * self.columns))
            found = [
                torch.sigmoid(self.overlap_logits(queries[part[:, 0]], database[part[:, 1]]))
                for part in torch.split(chosen, at_once)
            ]
            score = score.index_put(tuple(chosen.T), torch.cat(found))
        with torch.no_grad():
            rows = max(1, _CURVES // (len(database) * self.columns))
            shifts = [
                correlation_curves(part, database).argmax(dim=-1)
                for part in torch.split(queries, rows)
            ]
        return Comparison(score, shift_to_turn(torch.cat(shifts), self.columns))

    @property
    def descriptor_shape(self) -> tuple[int, int]:
        """Columns and channels."""
        return (self.columns, self.settings.layers[-1][-1])

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Search by `compare`; takes no settings."""
        if self.settings.candidates is None:
            return CompareIndex(self)
        return ShortlistIndex(self, mean_columns, self.settings.candidates)


def rolled(
    columns: Float[Tensor, "n column value"], shifts: Int64[Tensor, " n"]
) -> Float[Tensor, "n column value"]:
    """Each scan's columns rolled by its own shift.

    >>> rolled(torch.tensor([[[1.0], [2.0], [3.0]]]), torch.tensor([1]))[0, :, 0]
    tensor([3., 1., 2.])
    """
    count = columns.shape[1]
    rows = (torch.arange(count, device=columns.device) - shifts[:, None]) % count
    return columns.gather(1, rows[..., None].expand_as(columns))


def mean_columns(columns: Float[Tensor, "n column value"]) -> Float[Tensor, "n 1 value"]:
    """Means over the columns at unit norm, which no roll changes: the order is by their cosine."""
    means = columns.float().mean(dim=1, keepdim=True)
    return means / means.square().sum(dim=-1, keepdim=True).clamp_min(1e-24).sqrt()
