"""Locus (Vidanapathirana et al., ICRA 2021): features of segments, pooled to second order."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from jaxtyping import Bool, Float, Integer, Shaped
from torch import Tensor

from deepring import checks
from deepring.core.similarity import cosine
from deepring.methods.locus.pooling import descriptor_of, pooled_neighbours
from deepring.methods.locus.segment_network import SegmentNetwork
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.rasters import SegmentsRaster, raster_settings
from deepring.rasters.segments import Segments, unpack_voxels
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.vector_index import VectorIndex


@dataclass(frozen=True)
class LocusSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "Locus, spatial"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(SegmentsRaster()))
    channels: Sequence[int] = (32, 64, 64)  # of the three convolutions over voxels
    hidden: int = 512  # width of the dense layer
    feature: int = 64  # length of a segment's feature; the descriptor has its square
    dropout: float = 0.5  # share of the dense layer's values, in training
    neighbours: int = 5  # nearest segments that each is multiplied with
    least_segments: int = 7  # without which a scan is described by zeros
    exponent: float = 0.5  # power of the singular values of a descriptor


class Locus(NetworkMethod):
    """Segments (b, max_segments, bytes) -> descriptors (b, feature²) of unit norm.

    Each segment's features are multiplied with those of the segments around it; the largest
    products of all segments are the descriptor, after a power of their singular values. This is
    Locus with spatial pooling alone: `deepring.methods.locus.temporal` pools over consecutive
    scans too, which are no matter of one scan. Scans of fewer than ``least_segments`` segments
    have zeros for a descriptor, and a score of 0 with every place.
    """

    settings_class = LocusSettings
    settings: LocusSettings

    def __init__(self, settings: LocusSettings | None = None) -> None:
        settings = LocusSettings() if settings is None else settings
        super().__init__(settings, SegmentsRaster)
        checks.count("locus.neighbours", settings.neighbours)
        checks.count("locus.least_segments", settings.least_segments)
        checks.positive("locus.exponent", settings.exponent)
        assert isinstance(self.raster, SegmentsRaster)
        self.segment_network = SegmentNetwork(
            *(self.raster.cells, settings.channels, settings.hidden, settings.feature),
            settings.dropout,
        )

    def forward(self, rasters: Integer[Tensor, "batch s byte"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, feature²) float32 of segments (b, max_segments, bytes).

        Raises DataError for rasters that no `SegmentsRaster` makes.
        """
        segments = self.segments(rasters)
        features = self.features(segments)
        pooled = pooled_neighbours(features, segments.distances, self.settings.neighbours)
        return self.descriptors(segments.present, features, pooled)

    def segments(self, rasters: Integer[Tensor, "batch s byte"]) -> Segments:
        """What rasters hold."""
        assert isinstance(self.raster, SegmentsRaster)
        return self.raster.segments(rasters)

    def segment_features(
        self, voxels: Shaped[Tensor, "n x y z"], extents: Float[Tensor, "n 3"]
    ) -> Float[Tensor, "n feature"]:
        """Features of segments, none below 0: what `training.segments` trains."""
        features: Tensor = self.segment_network(voxels, extents)
        return features

    def features(self, segments: Segments) -> Float[Tensor, "b s feature"]:
        """Features of the segments of b scans; zeros where there is no segment."""
        assert isinstance(self.raster, SegmentsRaster)
        present = segments.present
        voxels = unpack_voxels(segments.bits[present], self.raster.cells)
        features = segments.extents.new_zeros(*present.shape, self.settings.feature)
        features[present] = self.segment_features(voxels, segments.extents[present])
        return features

    def descriptors(
        self,
        present: Bool[Tensor, "b s"],
        features: Float[Tensor, "b s feature"],
        pooled: Float[Tensor, "b s feature"],
    ) -> Float[Tensor, "b value"]:
        """Descriptors of features and of what is pooled for each; zeros for too few segments."""
        enough = present.sum(dim=1) >= self.settings.least_segments
        described = descriptor_of(features, pooled, self.settings.exponent)
        return described * enough[:, None]

    def compare(
        self, queries: Float[Tensor, "q value"], database: Float[Tensor, "d value"]
    ) -> Comparison:
        """The cosine; the turn is not known."""
        return Comparison(cosine(queries, database), None)

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Exhaustive search by the cosine, see `index_of`; takes no settings."""
        return VectorIndex("cosine")

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.settings.feature**2,)
