"""RINet (Li et al., RA-L 2022): what stands in each direction, described whatever the turn."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod, PlainSettings
from deepring.methods.rinet.rinet_network import Describer, MatchHead
from deepring.rasters import SemanticRangesRaster, raster_settings

#: Pairs whose features are in memory at once.
_PAIRS = 2**14


@dataclass(frozen=True)
class RINetSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "RINet"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(SemanticRangesRaster()))
    widths: Sequence[int] = (16, 16, 32, 32, 64, 128)  # channels of each stage
    #: by which each further stage thins θ; their product divides the sectors
    steps: Sequence[int] = (3, 3, 2, 2, 2)
    hidden: int = 128  # width of the layer that compares two descriptors
    gates: bool = True  # weigh channels by the whole scan


class RINet(NetworkMethod):
    """Ranges (b, θ, channels) -> descriptors (b, sum of ``widths``), compared by a network.

    A turn of the scan by whole sectors changes nothing, but where two subsamplings are equally
    good, see `strongest_phase`.
    """

    settings_class = RINetSettings
    settings: RINetSettings

    def __init__(self, settings: RINetSettings | None = None) -> None:
        settings = RINetSettings() if settings is None else settings
        super().__init__(settings)
        if self.raster.axes != ("theta", "channel"):
            raise ConfigError(
                f"RINet: raster: a {type(self.raster).__name__}, expected a SemanticRangesRaster "
                "or a HeightRangesRaster"
            )
        widths = checks.widths("rinet.widths", settings.widths)
        steps = [checks.count("rinet.steps", step) for step in settings.steps]
        sectors, channels = self.raster.shape
        if len(steps) != len(widths) - 1:
            raise ConfigError(
                f"rinet.steps: {steps}, expected one fewer than rinet.widths, {len(widths) - 1}: "
                "the first stage is not subsampled"
            )
        if sectors % math.prod(steps) or sectors // math.prod(steps) < 2:
            raise ConfigError(
                f"rinet.steps: {steps}, expected numbers whose product {math.prod(steps)} divides "
                f"the {sectors} sectors of the raster, and leaves 2 or more"
            )
        hidden = checks.count("rinet.hidden", settings.hidden, most=8192)
        gates = checks.of_type("rinet.gates", settings.gates, bool)
        self.describer = Describer(channels, widths, steps, gates)
        self.head = MatchHead(sum(widths), hidden)

    def forward(
        self, rasters: Float[Tensor, "batch theta channel"]
    ) -> Float[Tensor, "batch value"]:
        """Descriptors (b, sum of widths) float32."""
        descriptors: Tensor = self.describer(rasters.float().transpose(1, 2))
        return descriptors

    def match_logits(
        self, first: Float[Tensor, "n value"], second: Float[Tensor, "n value"]
    ) -> Float[Tensor, " n"]:
        """Logits (n,) that each first and second (n, d) are of one place."""
        logits: Tensor = self.head(first, second)
        return logits

    def compare(
        self, queries: Float[Tensor, "q value"], database: Float[Tensor, "d value"]
    ) -> Comparison:
        """Logits of a match; their sigmoid is its probability. The turn is not known."""
        if not len(queries) or not len(database):
            return Comparison(queries.new_zeros(len(queries), len(database)), None)
        rows = max(1, _PAIRS // len(database))
        # Only descriptors under training want the gradient, the head's weights alone do not.
        wanted = torch.is_grad_enabled() and (queries.requires_grad or database.requires_grad)
        with torch.set_grad_enabled(wanted):
            blocks = [
                self.head(part[:, None], database[None]) for part in torch.split(queries, rows)
            ]
        return Comparison(torch.cat(blocks), None)

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (sum(self.settings.widths),)
