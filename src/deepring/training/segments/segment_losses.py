"""The loss of segments: which thing each is of, and what it looks like (SegMap)."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError
from deepring.training.scheme import Step

#: Channels of the voxels that are drawn again.
_CHANNELS = 32


class SegmentLoss(nn.Module, ABC):
    """Base class of losses of segments."""

    #: How many identities it can tell apart.
    identities: int

    @abstractmethod
    def forward(self, features: Tensor, voxels: Tensor, identity: Tensor) -> Step:
        """Loss of features (n, feature), voxels (n, x, y, z) of 0 and 1 and identities (n,)."""

    def expect(self, features: Tensor, voxels: Tensor) -> None:
        """Raise ConfigError for features and voxels of sizes that it does not take; here none."""


class SegmentIdentity(SegmentLoss):
    """Cross-entropy over identities, and of the voxels that the features are drawn again as.

    The loss is the cross-entropy of a linear layer over batch-normalised features, and
    ``reconstruction`` times the mean over voxels of -[w x log p + (1 - w)(1 - x) log(1 - p)], p of
    a decoder: a dense layer and transposed convolutions up to the grid. The share w = ``missed``
    weighs occupied voxels more, since most are free. Both heads are of the training alone.

    Source: SegMap (Dubé et al., RSS 2018; ethz-asl/segmap).

    Args:
        identities: how many are told apart, at most.
        feature: length of a feature.
        cells: voxels of a segment along x, y and z, those of the method's raster.
        reconstruction: weight of the voxels' cross-entropy.
        missed: weight of an occupied voxel, in (0, 1).
        dropout: of features before the linear layer.
    """

    def __init__(
        self,
        identities: int = 8192,
        feature: int = 64,
        cells: Sequence[int] = (32, 32, 16),
        reconstruction: float = 200.0,
        missed: float = 0.9,
        dropout: float = 0.35,
    ) -> None:
        super().__init__()
        self.identities = checks.count("loss.identities", identities, 2)
        self.feature = checks.count("loss.feature", feature)
        self.cells = tuple(checks.count("loss.cells", n, 4) for n in cells)
        if len(self.cells) != 3 or any(n % 4 for n in self.cells):
            raise ConfigError(f"loss.cells: {list(cells)}, expected three numbers that 4 divides")
        self.reconstruction = checks.at_least("loss.reconstruction", reconstruction, 0)
        self.missed = checks.fraction("loss.missed", missed)
        checks.share("loss.dropout", dropout)
        self.classes = nn.Sequential(
            nn.BatchNorm1d(feature), nn.Dropout(dropout), nn.Linear(feature, identities)
        )
        self.decoder = _decoder(feature, self.cells)

    def forward(self, features: Tensor, voxels: Tensor, identity: Tensor) -> Step:
        """See `SegmentLoss`; ``parts`` has both terms. Raises ConfigError for other sizes."""
        self.expect(features, voxels)
        logits = self.classes(features)
        told = F.cross_entropy(logits, identity)
        x, drawn = voxels.to(features.dtype), self.decoder(features)[:, 0]
        weight = torch.where(x > 0, self.missed, 1 - self.missed)
        seen = F.binary_cross_entropy_with_logits(drawn, x, weight)
        right = (logits.argmax(dim=1) == identity).float().mean()
        parts = {"identity": told.detach(), "voxels": seen.detach()}
        return Step(told + self.reconstruction * seen, right, parts)

    def expect(self, features: Tensor, voxels: Tensor) -> None:
        """See `SegmentLoss`: features and voxels of the heads' sizes."""
        if features.shape[1] != self.feature:
            raise ConfigError(
                f"loss.feature: {self.feature}, expected method.feature={features.shape[1]}"
            )
        if tuple(voxels.shape[1:]) != self.cells:
            raise ConfigError(
                f"loss.cells: {list(self.cells)}, expected method.raster.cells="
                f"{list(voxels.shape[1:])}"
            )


def _decoder(feature: int, cells: Sequence[int]) -> nn.Sequential:
    """Logits (n, 1, *cells) of features (n, feature)."""
    coarse = [n // 4 for n in cells]

    def doubled() -> nn.ConvTranspose3d:
        return nn.ConvTranspose3d(
            _CHANNELS, _CHANNELS, 3, stride=2, padding=1, output_padding=1, bias=False
        )

    return nn.Sequential(
        nn.Linear(feature, _CHANNELS * math.prod(coarse)),
        nn.ReLU(),
        nn.Unflatten(1, (_CHANNELS, *coarse)),
        doubled(),
        nn.ReLU(),
        doubled(),
        nn.ReLU(),
        nn.ConvTranspose3d(_CHANNELS, 1, 3, padding=1, bias=False),
    )
