"""DeepRING: sinogram, circular UNet, row-wise DFT magnitude, circular cross-correlation.

The paper's equations, and where they are (`tests/test_paper_equations.py` has a test for each):

    1  sinogram: integrals over lines x cos θ + y sin θ = τ    core.radon.radon
    2  a turn of the scan shifts the sinogram along θ          core.radon; core.equivariance
    3  a translation shifts each row by its projection         core.radon; core.equivariance
    4  a translation moves polar cells nonlinearly             rasters.polar.polar_gram
    5  convolution that wraps around both axes                 nn.circular.CircularConv2d
    6  features shift along τ with the sinogram                nn.unet.CircularUNet
    7  the magnitude of a row's DFT forgets the shift          core.spectrum.row_dft_magnitude
    8  similarity: largest circular cross-correlation over θ   core.correlation
    9  softmax(W C + b) over the ways of an episode            training.episodes.OneShotClassifier
    -  cross-entropy over the ways, not numbered in the paper  training.episodes.OneShotCrossEntropy
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from jaxtyping import Float, Shaped
from torch import Tensor, nn

from deepring.checks import count, one_of
from deepring.core.correlation import (
    circular_cross_correlation,
    shift_to_turn,
    standardise,
    unit_norm,
)
from deepring.core.radon import ThetaRange
from deepring.core.similarity import cosine, negative_distance
from deepring.errors import ConfigError
from deepring.methods.deepring.polar_branch import PolarBranch, PolarSettings
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.nn.aggregation import AGGREGATIONS, ROTATION_INVARIANT, make_aggregation
from deepring.nn.circular import TauPadding
from deepring.nn.representation import make_representation
from deepring.nn.unet import CircularUNet
from deepring.rasters import BevRaster, raster_settings
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.vector_index import VectorIndex

NORMALISATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "unit": unit_norm,
    "standard": lambda d: standardise(d) / (d.shape[-2] * d.shape[-1]) ** 0.5,
    "none": lambda d: d,
}
"""Normalisations of a descriptor: unit norm; zero mean and unit norm; none.

Both are taken over the weighted half spectrum. For the norm that is the full one's; the mean of
'standard' is a choice of its own."""

SIMILARITIES = ("correlation", "l2", "cosine")
"""Similarities of two descriptors: correlation at the best rotation, or a distance without one."""

_PERIOD = {"full": 2 * math.pi, "half": math.pi}


@dataclass(frozen=True)
class RepresentationSettings(PlainSettings):
    """How the network sees the raster; see `deepring.nn.representation`."""

    angles: int | None = 120  # of the sinogram; None for the other rasters
    bins: int | None = 120  # of τ
    theta_range: ThetaRange = "full"  # [0, 2π), or [0, π)
    pool: int = 1  # averages squares of so many cells


@dataclass(frozen=True)
class EncoderSettings(PlainSettings):
    """See `deepring.nn.unet.CircularUNet`. The paper gives no widths; these are DiSCO's."""

    widths: Sequence[int] = (64, 128, 256, 512)  # channels of each level
    convolutions: int = 2  # of each level
    norm: str = "batch"  # or group, none
    tau_padding: TauPadding = "circular"  # beyond the ends of τ: circular, or zero
    stem: int = 1  # squares of so many cells become channels at the start


@dataclass(frozen=True)
class AggregationSettings(PlainSettings):
    """One of `deepring.nn.aggregation.AGGREGATIONS`; the others belong to 'cross_spectra' alone."""

    kind: str = "dft"  # dft, or another way to a descriptor without θ's phase
    gaps: Sequence[float] | None = None  # degrees between the rows that are multiplied
    frequencies: int | None = None  # of τ, the lowest ones


@dataclass(frozen=True)
class SimilaritySettings(PlainSettings):
    """The comparison of two descriptors, and their normalisation before it."""

    kind: str = "correlation"  # over all turns; l2 and cosine compare row with row
    normalisation: str = "unit"  # or standard, none


@dataclass(frozen=True)
class DeepRingSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "DeepRING"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(BevRaster()))
    representation: RepresentationSettings = RepresentationSettings()  # what the network sees
    encoder: EncoderSettings = EncoderSettings()  # the network
    aggregation: AggregationSettings = AggregationSettings()  # from features to a descriptor
    similarity: SimilaritySettings = SimilaritySettings()  # of two descriptors
    polar: PolarSettings | None = None  # a second look, beside the paper's network


class DeepRing(NetworkMethod):
    """The network of the paper's Fig. 1. Rasters in, roto-translation invariant descriptors out.

    Shapes: rasters (b, n, n) -> representation (b, 1, θ, τ) -> feature E_f (b, c, θ, τ)
    -> aggregated, M_f (b, θ, ω) -> normalised. An encoder with a stem divides θ and τ by it.
    Not of the paper: with ``settings.polar`` a second network stands beside it, see
    `deepring.methods.deepring.polar_branch`.
    """

    settings_class = DeepRingSettings
    settings: DeepRingSettings
    descriptor_shape: tuple[int, int]
    """(θ, ω) of one descriptor; beside ω stand the phases of 'cross_spectra', and r of `polar`."""

    def __init__(self, settings: DeepRingSettings | None = None) -> None:
        settings = DeepRingSettings() if settings is None else settings
        super().__init__(settings)
        representation, encoder = settings.representation, settings.encoder
        aggregation, similarity = settings.aggregation.kind, settings.similarity.kind
        gaps, frequencies = settings.aggregation.gaps, settings.aggregation.frequencies
        normalisation = settings.similarity.normalisation
        one_of("similarity.normalisation", normalisation, NORMALISATIONS)
        one_of("aggregation.kind", aggregation, AGGREGATIONS)
        one_of("similarity.kind", similarity, SIMILARITIES)
        if similarity == "correlation" and aggregation in ROTATION_INVARIANT:
            raise ConfigError(
                f"similarity.kind: 'correlation' with aggregation.kind: {aggregation!r}, "
                "whose rows are no directions to search over; take the similarity l2 or cosine"
            )
        if aggregation == "cross_spectra" and representation.theta_range == "half":
            raise ConfigError(
                "aggregation.kind: 'cross_spectra' with representation.theta_range: 'half', whose "
                "rows come back flipped, which turns their phases; take the theta_range 'full'"
            )
        self.representation = make_representation(
            self._raster,
            representation.angles,
            representation.bins,
            representation.pool,
            representation.theta_range,
        )
        stem = count("encoder.stem", encoder.stem, most=64)
        rows, columns = self.representation.rows // stem, self.representation.columns // stem
        made = make_aggregation(aggregation, rows, columns, gaps, frequencies)
        self.aggregate, self.descriptor_shape = made.function, (rows, made.values)
        self.encoder = CircularUNet(
            encoder.widths,
            out_channels=made.channels,
            convolutions=encoder.convolutions,
            norm=encoder.norm,
            tau_padding=encoder.tau_padding,
            theta_range=representation.theta_range,
            stem=encoder.stem,
        )
        self.encoder.check_size(self.representation.rows, self.representation.columns)
        self.normalise = NORMALISATIONS[normalisation]
        self.polar = self._polar_branch(rows)
        if self.polar is not None:
            self.descriptor_shape = (rows, made.values + self.polar.image.rings)

    def _polar_branch(self, rows: int) -> PolarBranch | None:
        """The second look, if there is one. Raises ConfigError where it could not be correlated."""
        settings = self.settings
        if settings.polar is None:
            return None
        needed = {
            "similarity.kind": (settings.similarity.kind, ("correlation",), "curves to add"),
            "similarity.normalisation": (
                settings.similarity.normalisation,
                ("unit", "standard"),
                "parts of the same norm",
            ),
            "representation.theta_range": (
                settings.representation.theta_range,
                ("full",),
                "rows over a full turn, as those of a polar image",
            ),
        }
        for key, (value, possible, why) in needed.items():
            if value not in possible:
                raise ConfigError(
                    f"{key}: {value!r} with a polar branch, which needs {why}; expected "
                    f"{' or '.join(possible)}, or polar: null"
                )
        return PolarBranch(settings.polar, self.raster, rows)

    def forward(
        self, rasters: Shaped[Tensor, " batch *raster"]
    ) -> Float[Tensor, "batch theta value"]:
        """Descriptors M_f (b, θ, ω) of rasters (b, *raster.shape); (b, θ, ω + r) with `polar`."""
        image = self.representation(rasters)
        feature = self.encoder(image)
        descriptor = self.normalise(self.aggregate(feature))
        if self.polar is None:
            return descriptor
        return self.polar.joined(descriptor, self.normalise(self.polar(rasters)))

    def compare(
        self, queries: Float[Tensor, "q theta value"], database: Float[Tensor, "d theta value"]
    ) -> Comparison:
        """Correlation at the best rotation (Eq. 8), and that rotation; L2 and cosine find none.

        Over half a turn the rotation is known up to 180°.
        """
        match self.settings.similarity.kind:
            case "l2":
                return Comparison(negative_distance(queries, database), None)
            case "cosine":
                return Comparison(cosine(queries, database), None)
        match = circular_cross_correlation(queries, database)
        turn = shift_to_turn(match.shift, queries.shape[-2], self.turn_period)
        return Comparison(match.score, turn)

    @property
    def turn_period(self) -> float:
        """Radians that turns are known modulo: the range of θ."""
        return _PERIOD[self.settings.representation.theta_range]

    def index(self, settings: SearchSettings | None = None) -> Index:
        """Search by correlation, or exhaustively by a distance; see `index_of`."""
        match self.settings.similarity.kind:
            case "l2":
                return VectorIndex("l2")
            case "cosine":
                return VectorIndex("cosine")
        return CorrelationIndex(settings, period=self.turn_period)

    def onnx_form(self) -> nn.Module:
        """The network in real arithmetic, see `deepring.methods.deepring.real_form`."""
        from deepring.methods.deepring.real_form import RealDeepRing

        return RealDeepRing(self)
