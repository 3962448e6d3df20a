"""Training on scans that see a part: a random sector or random cells are lost.

A car's roof, a driver or a second sensor hides a sector, rain and distance thin what is left. Both
are applied to the raster, so that a cached one serves.
"""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from deepring.checks import between, interval, share
from deepring.errors import ConfigError
from deepring.methods.network import NetworkMethod
from deepring.rasters import Raster
from deepring.training.scheme import TrainingSet

Batch = TypeVar("Batch")

#: A stream of random numbers of its own beside that of the batches.
_STREAM = 1


@dataclass(frozen=True)
class Augmentation:
    """What the scans of a batch lose, each on its own. Angles in degrees."""

    blind: float = 0.0
    """The share of scans that lose a sector."""
    blind_width: tuple[float, float] = (20.0, 130.0)
    """The least and the largest width of the sector; its middle is anywhere."""
    dropped: float = 0.0
    """The largest share of a scan's occupied cells that are lost; each scan draws its own."""

    def __post_init__(self) -> None:
        share("augmentation.blind", self.blind)
        share("augmentation.dropped", self.dropped)
        width = interval("augmentation.blind_width", self.blind_width, "degrees")
        for end in width:
            between("augmentation.blind_width", end, 0, 360, "degrees")
        object.__setattr__(self, "blind_width", width)

    def __call__(self, rasters: Tensor, azimuth: Tensor, rng: np.random.Generator) -> Tensor:
        """Scans (n, *raster.shape) of occupancy without what they lose, in their dtype.

        ``azimuth`` are the radians of the cells, as `cell_azimuths` gives them.
        """
        n, cells = len(rasters), (...,) + (None,) * azimuth.ndim
        middle = rng.uniform(0, 2 * np.pi, n)
        width = np.deg2rad(rng.uniform(*self.blind_width, n)) * (rng.random(n) < self.blind)
        kept = 1 - rng.uniform(0, self.dropped, n)
        offset = torch.remainder(azimuth - torch.from_numpy(middle)[cells], 2 * np.pi)
        away = torch.minimum(offset, 2 * np.pi - offset)
        seen = away >= torch.from_numpy(width / 2)[cells]
        if self.dropped:
            chance = torch.from_numpy(rng.random(rasters.shape, dtype=np.float32))
            seen &= chance < torch.from_numpy(kept)[cells]
        return rasters * seen.to(rasters.dtype)


def cell_azimuths(raster: Raster) -> Tensor:
    """Azimuth of each cell's centre, float64 radians counter-clockwise from x, in the raster's
    shape or one that spreads to it.

    Raises ConfigError for another raster than occupancy over x and y or over θ.
    """
    if raster.dtype == np.bool_ and raster.axes[0] == "theta":
        sectors = raster.shape[0]
        middles = (torch.arange(sectors, dtype=torch.float64) + 0.5) * (2 * torch.pi / sectors)
        return middles.view(-1, *[1] * (len(raster.shape) - 1))
    if raster.dtype == np.bool_ and raster.axes == ("x", "y"):
        x, y = (torch.arange(n, dtype=torch.float64) - (n - 1) / 2 for n in raster.shape)
        return torch.atan2(y[None, :], x[:, None])
    raise ConfigError(
        f"augmentation: the method takes a {type(raster).__name__}, expected occupancy over x and "
        "y or over θ, whose cells can be lost; choose another method or augmentation=null"
    )


class AugmentedSet(TrainingSet[Batch]):
    """The batches of another set, whose ``rasters`` lose what `Augmentation` says."""

    def __init__(
        self, inner: TrainingSet[Batch], augmentation: Augmentation, raster: Raster, seed: int
    ) -> None:
        self.inner, self.augmentation, self.seed = inner, augmentation, seed
        self.azimuth = cell_azimuths(raster)

    def __len__(self) -> int:
        return len(self.inner)

    def __getitem__(self, index: int) -> Batch:
        batch: Any = self.inner[index]
        rng = np.random.default_rng([self.seed, index, _STREAM])
        changed: Batch = batch._replace(rasters=self.augmentation(batch.rasters, self.azimuth, rng))
        return changed

    def before_epoch(self, epoch: int, method: NetworkMethod) -> None:
        """See `TrainingSet`."""
        self.inner.before_epoch(epoch, method)

    def after_epoch(self, parts: Any) -> None:
        """See `TrainingSet`."""
        self.inner.after_epoch(parts)

    def state_dict(self) -> dict[str, Any]:
        """See `TrainingSet`."""
        return self.inner.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See `TrainingSet`."""
        self.inner.load_state_dict(state)
