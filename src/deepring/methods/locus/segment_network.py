"""The network of one segment: SegMap's convolutions over voxels.

Source: SegMap (Dubé et al., RSS 2018; ethz-asl/segmap), as Locus takes it.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError

#: Segments at once where no gradient is needed, so that scans of any number fit into memory.
_AT_ONCE = 64


class SegmentNetwork(nn.Module):
    """Voxels (n, x, y, z) and extents (n, 3), metres -> features (n, feature), none below 0.

    Three convolutions of 3³ with ReLU, the voxels halved after the first two; all values and the
    extents through ``hidden`` units with batch norm and dropout. At the published size, 32 x 32 x
    16 voxels with channels of 32, 64 and 64, it has 8 591 424 parameters.
    """

    def __init__(
        self,
        cells: Sequence[int] = (32, 32, 16),
        channels: Sequence[int] = (32, 64, 64),
        hidden: int = 512,
        feature: int = 64,
        dropout: float = 0.5,
    ) -> None:
        super().__init__()
        if len(channels) != 3:
            raise ConfigError(
                f"locus.channels: {list(channels)}, expected three numbers, one for each "
                "convolution"
            )
        first, second, third = (checks.count("locus.channels", n, most=8192) for n in channels)
        checks.count("locus.hidden", hidden, most=8192)
        checks.count("locus.feature", feature, most=8192)
        checks.share("locus.dropout", dropout)
        self.convolutions = nn.Sequential(
            nn.Conv3d(1, first, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool3d(2),
            nn.Conv3d(first, second, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool3d(2),
            nn.Conv3d(second, third, 3, padding=1),
            nn.ReLU(),
            nn.Flatten(),
        )
        values = third * cells[0] * cells[1] * cells[2] // 64
        self.dense = nn.Sequential(
            nn.Linear(values + 3, hidden),
            nn.ReLU(),
            nn.BatchNorm1d(hidden),
            nn.Dropout(dropout),
            nn.Linear(hidden, feature),
            nn.ReLU(),
        )
        for layer in self.modules():
            if isinstance(layer, nn.Conv3d | nn.Linear) and layer.bias is not None:
                nn.init.xavier_uniform_(layer.weight)
                nn.init.zeros_(layer.bias)

    def forward(
        self, voxels: Shaped[Tensor, "n x y z"], extents: Float[Tensor, "n 3"]
    ) -> Float[Tensor, "n feature"]:
        """Features of segments; see the class."""
        if torch.is_grad_enabled() or len(voxels) <= _AT_ONCE:
            return self._features(voxels, extents)
        lots = zip(torch.split(voxels, _AT_ONCE), torch.split(extents, _AT_ONCE), strict=True)
        return torch.cat([self._features(*lot) for lot in lots])

    def _features(self, voxels: Tensor, extents: Tensor) -> Tensor:
        values = self.convolutions(voxels.to(extents.dtype)[:, None])
        features: Tensor = self.dense(torch.cat([values, extents], dim=1))
        return features
